"""The smallest world of a stored failure, by the directory of its campaign."""

from __future__ import annotations

from collections.abc import Callable

from mrta_falsify.analysis.minimize import minimize
from mrta_falsify.analysis.minimize.minimising import MAX_RUNS
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.trust import Trust, open_to_run, permit_runs
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.findings import Minimisation


def minimize_trial(
    directory: Place,
    id: str | int,
    max_runs: int = MAX_RUNS,
    *,
    workers: int | None = None,
    trust: Trust = False,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimisation:
    """Find the smallest world that fails in the same way, and write it beside the trial.

    Args:
        directory: of the campaign.
        id: of the trial.
        max_runs: simulations at most, beside ten of the result; a second call with more goes on.
        workers: processes; one per core if None.
        trust: run what is not ours, though somebody else has made the campaign.
        on_run: called after each simulation with their number and a line about it.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    campaign = open_to_run(directory, trust)
    record = campaign.record(str(id))
    permit_runs(campaign, (record,), trust, with_other=record.other is not None)
    return minimize(
        campaign, record, max_runs=max_runs, workers=count_cores(workers), on_run=on_run
    )
