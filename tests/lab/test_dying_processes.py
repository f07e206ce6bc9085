"""Processes of the lab that are killed: what they ran is run again."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.campaigns.executors import Finished
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.lab import Experiment, Lab, laboratory


@pytest.fixture
def ran(monkeypatch, hall):
    """Run three experiments in processes, each of whose runs ends ``.`` well or ``x`` killed."""

    def run(ends):
        left, jobs = iter(ends), []

        class Executor:
            def open(self, settings):
                assert settings.target == "experiments"

            def submit(self, job):
                jobs.append(job)

            def collect(self, timeout):
                job = jobs.pop(0)
                if next(left) == "x":
                    return (Finished(number=job["number"], fate="crashed", error="signal 9"),)
                result = RunResult(status="judged", detail=str(job["group"][0]["repeat"]))
                record = {"results": [codec.encode(result)]}
                return (Finished(number=job["number"], fate="ok", record=record),)

            def close(self):
                jobs.clear()

        monkeypatch.setattr(laboratory.registry, "build", lambda *args, **more: Executor())
        own = Experiment(world=hall, stack=StackConfig())
        with Lab(workers=2) as lab:
            found = lab.map(dataclasses.replace(own, repeat=number) for number in range(3))
            return [result.detail for result in found]

    return run


@pytest.mark.parametrize("ends", ["...", "x...", ".x..", "xxxxxx...", "x.x.x."])
def test_what_a_killed_process_ran_is_run_again(ran, ends):
    assert ran(ends) == ["0", "1", "2"]


def test_a_run_whose_process_dies_three_times_ends_it(ran):
    with pytest.raises(HarnessError, match="crashed: signal 9"):
        ran("x" * 9)
