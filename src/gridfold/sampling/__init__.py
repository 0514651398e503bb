"""Labelled data sets of operating points and faults: from a plan to Parquet files and a data card."""

from gridfold.sampling.engine import SampleProgress, SampleRun, sample
from gridfold.sampling.plan import SamplePlan, load_plan, plan_schema, write_plan
from gridfold.sampling.single import SingleSample, single_sample

__all__ = [
    "SamplePlan",
    "SampleProgress",
    "SampleRun",
    "SingleSample",
    "load_plan",
    "plan_schema",
    "sample",
    "single_sample",
    "write_plan",
]
