"""The lab: worlds run under a stack, changed from a moment on, repeated with small differences."""

from mrta_falsify.core.run_result import Course, RunResult, TimedPose, Vote
from mrta_falsify.lab.course import course_of
from mrta_falsify.lab.experiment import (
    Edit,
    Experiment,
    KeptTrace,
    SceneSource,
    Situation,
    certain,
)
from mrta_falsify.lab.laboratory import Lab, OnRun
from mrta_falsify.lab.recorded import (
    experiment_of_record,
    experiment_of_trial,
    open_program,
    specifications_of,
    stack_of,
)
from mrta_falsify.lab.running import experiment_of_job, job_of_experiment, result_of

__all__ = [
    "Course",
    "Edit",
    "Experiment",
    "KeptTrace",
    "Lab",
    "OnRun",
    "RunResult",
    "SceneSource",
    "Situation",
    "TimedPose",
    "Vote",
    "certain",
    "course_of",
    "experiment_of_job",
    "experiment_of_record",
    "experiment_of_trial",
    "job_of_experiment",
    "open_program",
    "result_of",
    "specifications_of",
    "stack_of",
]
