"""Studies of many contingencies: from a study file to a table of figures."""

from gridfold.contingencies.engine import run_study
from gridfold.contingencies.executors import Workers
from gridfold.contingencies.study_file import Study, json_schema, load_study, write_template
from gridfold.contingencies.work import Progress, Stage, StudyRun

__all__ = [
    "Progress",
    "Stage",
    "Study",
    "StudyRun",
    "Workers",
    "json_schema",
    "load_study",
    "run_study",
    "write_template",
]
