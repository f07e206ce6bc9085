"""Why a stored failure happens, by the directory of its campaign."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable

from mrta_falsify.analysis.explain import MAX_RUNS, REWINDS, explain
from mrta_falsify.analysis.explain.explaining import Keep
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.run import write_run
from mrta_falsify.commands.trust import Trust, open_to_run, permit_runs
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import Explanation
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.trial import Judged

EXPLAINED = "explain"  # folder of the runs that are kept, beside the trial


def explain_trial(
    directory: Place,
    id: str | int,
    max_runs: int = MAX_RUNS,
    *,
    rewinds: int = REWINDS,
    keep: bool = False,
    workers: int | None = None,
    trust: Trust = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Find the layer that a failure belongs to, by re-runs with one thing changed before its onset.

    The answer is kept beside the trial, for the report.

    Args:
        directory: of the campaign.
        id: of the trial.
        max_runs: re-runs at most.
        rewinds: copies at most, beside these, that tell when the failure was decided; 0: none.
        keep: write a run of each exchange that removes the failure into ``explain`` beside the
            trial, and one of the stack as it is.
        workers: processes; None: as many as the machine has cores.
        trust: run what is not ours, though somebody else has made the campaign.
        on_done: called after each re-run with how many are done, and how many there will be.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    campaign = open_to_run(directory, trust)
    record = campaign.record(str(id))
    permit_runs(campaign, (record,), trust)
    return explain(
        campaign,
        record,
        max_runs=max_runs,
        rewinds=rewinds,
        keep=_keeping(campaign, record) if keep else None,
        workers=count_cores(workers),
        on_done=on_done,
    )


def _keeping(campaign: Campaign, record: TrialRecord) -> Keep:
    """Make room for the runs that are kept, and say how they are written."""
    folder = campaign.folder(record) / EXPLAINED
    shutil.rmtree(folder, ignore_errors=True)
    again = shlex.join(["mrta-falsify", "explain", str(campaign.directory), record.id, "--keep"])

    def write(name: str, config: StackConfig, world: World, judged: Judged) -> None:
        write_run(judged.outcome, world, folder / name, config=config, again=again)

    return write
