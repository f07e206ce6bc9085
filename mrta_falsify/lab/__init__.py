"""The lab: worlds run under a stack, changed from a moment on, repeated with small differences."""

from mrta_falsify.core.run_result import Course, RunResult, TimedPose, Vote
from mrta_falsify.lab.course import course_of
from mrta_falsify.lab.experiment import Edit, Experiment, Situation
from mrta_falsify.lab.laboratory import Lab, experiment_of_job

__all__ = [
    "Course",
    "Edit",
    "Experiment",
    "Lab",
    "RunResult",
    "Situation",
    "TimedPose",
    "Vote",
    "course_of",
    "experiment_of_job",
]
