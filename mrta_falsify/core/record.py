"""The record of one trial: what a campaign stores."""

from __future__ import annotations

import importlib.metadata
import platform
from dataclasses import dataclass, field
from typing import Literal

from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.verdict import Verdict

Status = Literal["ok", "rejected", "crashed", "timeout"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialRecord:
    """One trial, finished for good."""

    candidate: Candidate
    status: Status
    world_digest: str = ""
    verdicts: tuple[Verdict, ...] = ()
    score: float = 0.0  #: smallest robustness, the search minimises it
    signature: str = ""  #: of the failure mode, empty if nothing failed
    trace_file: str = ""  #: relative to the campaign directory, empty if not kept
    trace_digest: str = ""
    sim_time: float = 0.0  #: simulated [s]
    wall_s: float = 0.0
    versions: dict[str, str] = field(default_factory=dict)
    error: str = ""  #: for crashed and timeout

    @property
    def failed(self) -> bool:
        """Whether a specification was violated; an error is not a failure."""
        return any(verdict.violated for verdict in self.verdicts)


def versions() -> dict[str, str]:
    """Versions and machine type that a trace digest depends on."""
    names = ("mrta-falsify", "scenic", "pybullet", "numpy", "scipy", "numba", "osqp", "ompl")
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return found
