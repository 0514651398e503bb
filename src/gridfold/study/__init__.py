"""Studies of many contingencies: from a study file to a table of figures."""

from gridfold.study.engine import run_study
from gridfold.study.executors import Workers
from gridfold.study.study_file import Study, json_schema, load_study, write_template
from gridfold.study.work import Progress, Stage, StudyRun

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
