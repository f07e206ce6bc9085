"""The failures of a campaign that a report shows in full, from their stored files."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns.attribution import blocked_time
from mrta_falsify.campaigns.signature import PRECEDENCE
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.difference import Difference
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import Jittered, TrialRecord
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import read_world
from mrta_falsify.verbs.campaign import modes
from mrta_falsify.verbs.explain import Removal, removal_text
from mrta_falsify.verbs.run import costmap_of
from mrta_falsify.worker import stack_of
from reports.contents import CaseContents, Counterfactual, FailureFamily
from reports.sentences import listed

if TYPE_CHECKING:
    from mrta_falsify.core.config import StackConfig

MOST_LOST = 20  # failures with missing files after which nobody looks further
LOST_TOLD = 5  # of which each gets a sentence


def readable_cases(campaign: Campaign, most: int) -> tuple[list[CaseContents], list[str]]:
    """Cases to show, and sentences about failures whose files are missing or damaged.

    Args:
        campaign: whose failures.
        most: cases to show.
    """
    cases: list[CaseContents] = []
    lost: list[str] = []
    for record in in_turn(campaign):
        if len(cases) >= most or len(lost) >= MOST_LOST:
            break
        try:
            cases.append(case_of(campaign, record))
        except InputError as error:
            lost.append(f"{error}")
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            folder = campaign.folder(record)
            lost.append(f"a file in {folder} is damaged ({error})")
        else:
            continue
        again = shlex.join(["mrta-falsify", "replay", str(campaign.directory), record.id])
        lost[-1] = (
            f"Trial {record.id} is not shown in full: {lost[-1].rstrip('.')}. It can still be run "
            f"again: {again}"
        )
    if len(lost) > LOST_TOLD:
        further = f"{len(lost) - LOST_TOLD} further failures have damaged or missing files, too"
        more = "; others were not looked at" if len(lost) >= MOST_LOST else ""
        lost = [*lost[:LOST_TOLD], f"{further}{more}."]
    return cases, lost


def in_turn(campaign: Campaign) -> Iterator[TrialRecord]:
    """Failures whose runs were kept: of each mode the first, then of each the second, and so on."""
    by_id = {record.id: record for record in campaign.records if record.trace_file}
    queues = [[by_id[i] for i in mode["ids"] if i in by_id] for mode in modes(campaign)]
    for turn in range(max(map(len, queues), default=0)):
        for queue in queues:
            if turn < len(queue):
                yield queue[turn]


def case_of(campaign: Campaign, record: TrialRecord) -> CaseContents:
    """A stored failure as the report shows it.

    Raises:
        FormatError: its files are damaged.
    """
    folder = campaign.folder(record)
    config = stack_of(campaign.settings.trials, record)
    trace = read_trace(folder / "trace.zip")
    explained = _stored(folder / "explain.json")
    verdicts = in_order(record.verdicts)
    layer = explained.get("layer", "") or record.layer
    return CaseContents(
        id=record.id,
        signature=record.signature,
        world=(world := read_world(folder / "world.json")),
        trace=trace,
        verdicts=verdicts,
        costmap=costmap_of(world, config),
        facts=_facts(campaign, record),
        commands=commands_of(campaign, record),
        layer=layer,
        layer_evidence=_layer_evidence(explained, verdicts, trace),
        counterfactuals=tuple(
            Counterfactual(
                change=row["change"], failure_gone=row["failure_gone"], detail=row["detail"]
            )
            for row in explained.get("counterfactuals", [])
        ),
        removals=tuple(
            removal_text(codec.decode(Removal, row, where=str(folder / "explain.json")))
            for row in explained.get("removals", [])
        ),
        family=_family(folder),
        **_checks(folder, explained, record.jittered),
        **_minimised(campaign, record, config),
    )


def in_order(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """The verdict that explains the run first, its consequences after it."""
    rank = {name: i for i, name in enumerate(PRECEDENCE)}
    return tuple(sorted(verdicts, key=lambda v: (not v.violated, rank.get(v.spec, -1), v.spec)))


# --- what other commands have found --------------------------------------------------------


def _stored(path: Path) -> dict[str, Any]:
    data = codec.read_json(path) if path.is_file() else {}
    return data if isinstance(data, dict) else {}


def _layer_evidence(explained: dict[str, Any], verdicts: Sequence[Verdict], trace: Trace) -> str:
    """Why a layer is suspected: what re-runs have shown, else what the trace shows."""
    if explained:
        changed_at = float(explained["changed_at"])
        text = f"Runs that differ in one layer from {changed_at:.1f} s on: {explained['reason']}."
        guess = explained.get("guess", "")
        if guess and guess != explained["layer"]:
            text += f" The trace alone had pointed to {guess}."
        return text
    verdict = next(iter(verdicts))
    until = verdict.violated_at if verdict.violated_at is not None else trace.duration
    members = [name for name in verdict.who if name in trace.robots] or list(trace.robots)
    spent = blocked_time(trace, until, members)
    who = listed(members) if len(members) <= 4 else f"the {len(members)} robots"
    if spent:
        causes = sorted(spent.items(), key=lambda item: (-item[1], item[0]))
        times = ", ".join(f"{time:.1f} s by {cause}" for cause, time in causes)
        seen = f"until {until:.1f} s, {who} had been blocked for {times}"
    else:
        seen = f"until {until:.1f} s, nothing had blocked {who}"
    return (
        f"A guess by rules from the trace: {seen}. The command explain tests it by runs with one "
        "layer changed."
    )


def _checks(folder: Path, explained: dict[str, Any], jittered: Jittered | None) -> dict[str, Any]:
    """What `replay --verify` and runs with small differences have shown."""
    found: dict[str, Any] = {}
    verified = _stored(folder / "verify.json")
    if verified:
        found["identical"] = (verified["identical"], verified["runs"])
        parts = verified.get("first_difference")
        if parts:
            where = codec.decode(Difference, parts, where=str(folder / "verify.json"))
            found["parts"] = f"first differs {where}"
    if explained.get("jittered", {}).get("runs"):
        found["jittered"] = (explained["jittered"]["failed"], explained["jittered"]["runs"])
    elif jittered is not None:
        found["jittered"] = (jittered.failed, jittered.runs)
    return found


def _family(folder: Path) -> FailureFamily | None:
    data = _stored(folder / "family.json")
    if not data:
        return None
    # beside the trial it is found wherever the campaign was moved to
    program = str(folder / "family.scenic")
    if not Path(program).is_file():
        program = data.get("program", "")
    there = bool(program) and Path(program).is_file()
    rule = data.get("rule") or [row["text"] for row in data["conditions"]]
    return FailureFamily(
        rule=tuple(rule),
        precision=data["sentence"],
        free=tuple(data["free"]),
        passing=tuple(data.get("passing", [])),
        program=program if there else "",
        commands=(
            (
                "Draw worlds of the family",
                shlex.join(["mrta-falsify", "sample", program, "-o", "family_samples"]),
            ),
        )
        if there
        else (),
    )


def _minimised(campaign: Campaign, record: TrialRecord, config: StackConfig) -> dict[str, Any]:
    folder = campaign.folder(record)
    found = _stored(folder / "minimize.json")
    if not found or not (folder / "world.min.json").is_file():
        return {}
    world = read_world(folder / "world.min.json")
    verdicts = codec.decode(_Verdicts, {"verdicts": found["verdicts"]}, where="minimize.json")
    case = CaseContents(
        id=f"{record.id}, minimised",
        signature=found["signature"],
        world=world,
        trace=read_trace(folder / "trace.min.zip"),
        verdicts=in_order(verdicts.verdicts),
        costmap=costmap_of(world, config),
        facts=(("world digest", world.digest()[:16]), ("runs used", str(found["runs"]))),
        commands=_minimised_commands(folder),
    )
    counts = tuple((name, *pair) for name, pair in found.get("counts", {}).items() if pair[0])
    return {"removed": tuple(found["removed"]), "counts": counts, "minimised": case}


def _minimised_commands(folder: Path) -> tuple[tuple[str, str], ...]:
    """How to run a minimised world on the stack that it fails on, from either of its files."""
    stack = folder / "stack.yaml"
    given = ["--stack", str(stack)] if stack.is_file() else []
    files = [("Run it", "world.min.json"), ("Run it from its Scenic program", "world.min.scenic")]
    return tuple(
        (what, shlex.join(["mrta-falsify", "run", str(folder / name), *given]))
        for what, name in files
        if (folder / name).is_file()
    )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Verdicts:
    verdicts: tuple[Verdict, ...]


# --- facts and commands --------------------------------------------------------------------


def _facts(campaign: Campaign, record: TrialRecord) -> tuple[tuple[str, str], ...]:
    return (
        ("trial", f"{record.id} of {campaign.directory}"),
        ("engine", record.engine),
        ("campaign seed", str(campaign.settings.trials.seed)),
        ("candidate seed", str(record.candidate.seed)),
        ("world digest", record.world_digest),
        ("trace digest", record.trace_digest),
        ("simulated", f"{record.sim_time:.1f} s, ended: {record.ended}"),
        ("scenes tried", str(record.attempts)),
        *sorted(record.versions.items()),
    )


def commands_of(campaign: Campaign, record: TrialRecord) -> tuple[tuple[str, str], ...]:
    """What to type to see, check and explain a failure."""
    where = [str(campaign.directory), record.id]
    world = campaign.folder(record) / "world.json"
    rows = (
        ("Run the trial again and compare digests", ["replay", *where, "--verify", "3"]),
        ("Ask which layer is to blame", ["explain", *where]),
        ("Find the smallest world that fails in the same way", ["minimize", *where]),
        (
            "Find the rule behind it: which dimensions matter, and how far they may move",
            ["family", *where],
        ),
        (
            "Run its world on its own, with your stack",
            ["run", str(world), "--stack", "my_stack.yaml"],
        ),
    )
    return tuple((what, shlex.join(["mrta-falsify", *words])) for what, words in rows)
