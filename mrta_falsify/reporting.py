"""The report of a campaign directory; reads what is stored and runs nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from mrta_falsify.app import costmap_of
from mrta_falsify.campaign.signature import PRECEDENCE, leading
from mrta_falsify.campaign.store import Campaign
from mrta_falsify.campaigns import modes, probability_of, screening_agreement
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World, read_world
from mrta_falsify.trial import quick_stack
from reports.campaign_page import Case, Counterfactual, Mode, Report, Table, Trials, write_report
from reports.sentences import edge_sentence, sentence

if TYPE_CHECKING:
    from mrta_falsify.core.config import StackConfig

MOST_CASES = 20  # shown in full


def write(campaign: Campaign, path: Path, *, against: Campaign | None = None) -> Path:
    """Write the HTML report of a campaign.

    Args:
        campaign: to report.
        path: the HTML file.
        against: a campaign with another stack on the same scenario, to compare with.

    Returns:
        ``path``.
    """
    write_report(report_of(campaign, against=against), path)
    return path


def report_of(campaign: Campaign, *, against: Campaign | None = None) -> Report:
    """What the page says, from what is stored."""
    settings = campaign.settings
    judged = [record for record in campaign.records if record.status == "ok"]
    errors = [record for record in campaign.records if record.status in ("crashed", "timeout")]
    failed = [record for record in judged if record.failed]
    found = modes(campaign)
    cases, lost = _readable_cases(campaign)
    floor = _any_world(campaign, judged)
    versions = next((record.versions for record in judged), {})
    return Report(
        title=f"{Path(settings.trials.scenario).stem}, seed {settings.trials.seed}",
        headline=headline(len(failed), len(judged), len(found)),
        facts=_facts(campaign, judged, failed, errors),
        modes=tuple(
            Mode(
                signature=mode["signature"],
                ids=tuple(mode["ids"]),
                cases=tuple(case for case in cases if case.signature == mode["signature"]),
            )
            for mode in found
        ),
        trials=_trials(judged, floor),
        errors=tuple((record.id, record.error.strip()) for record in errors),
        floor=floor,
        stack=yaml.safe_dump(codec.encode(settings.trials.stack), sort_keys=False),
        versions=tuple(sorted(versions.items())),
        notes=(*_notes(campaign), *lost),
        tables=(comparison_table(campaign, against),) if against is not None else (),
    )


def headline(failed: int, judged: int, count: int) -> str:
    """The result of a campaign in one line."""
    if not failed:
        return f"None of {judged} trials violates a specification"
    kinds = "one mode" if count == 1 else f"{count} modes"
    verb = "violates" if failed == 1 else "violate"
    return f"{failed} of {judged} trials {verb} a specification, in {kinds}"


def chosen_cases(campaign: Campaign) -> list[TrialRecord]:
    """Failures to show in full: of each mode the first, then of each the second, and so on."""
    by_id = {record.id: record for record in campaign.records if record.trace_file}
    queues = [[by_id[i] for i in mode["ids"] if i in by_id] for mode in modes(campaign)]
    chosen: list[TrialRecord] = []
    for turn in range(MOST_CASES):
        for queue in queues:
            if turn < len(queue) and len(chosen) < MOST_CASES:
                chosen.append(queue[turn])
    return chosen


def _facts(
    campaign: Campaign,
    judged: Sequence[TrialRecord],
    failed: Sequence[TrialRecord],
    errors: Sequence[TrialRecord],
) -> tuple[tuple[str, str], ...]:
    settings = campaign.settings
    rejected = sum(record.status == "rejected" for record in campaign.records)
    hours = sum(record.sim_time for record in judged) / 3600.0
    computed = sum(record.wall_s + record.scene_s for record in campaign.records)
    first = next((i for i, record in enumerate(judged, start=1) if record.failed), None)
    facts = [
        ("scenario", settings.trials.scenario),
        ("trials", str(len(judged))),
        ("failures", str(len(failed))),
        ("first failure", f"trial {first} of {len(judged)}" if first else "none"),
        ("scenes rejected", str(rejected)),
        ("errors of the toolkit", str(len(errors))),
        ("sampler", settings.sampler.name),
        ("search dimensions", str(settings.cube.dimensions)),
        ("simulated", f"{hours:.2f} h"),
        ("computed", f"{computed:.0f} s on one core"),
        ("specifications", ", ".join(settings.trials.specifications)),
    ]
    agreed = screening_agreement(campaign)
    if agreed is not None:
        text = f"{agreed['confirmed']} of {agreed['failed_in_screening']} kinematic failures"
        facts.append(("confirmed by physics", text))
    return tuple(facts)


def _notes(campaign: Campaign) -> tuple[str, ...]:
    chance = probability_of(campaign)
    if "why_not" in chance:
        return (f"No probability of failure is given: {chance['why_not']}.",)
    text = (
        f"Probability of a violation: {chance['estimate']:.3g}, "
        f"{chance['level']:.0%} interval [{chance['low']:.3g}, {chance['high']:.3g}] "
        f"({chance['method']}, {chance['trials']} independent trials)."
    )
    return (text,)


def _any_world(campaign: Campaign, judged: Sequence[TrialRecord]) -> World | None:
    for record in judged:
        path = campaign.folder(record) / "world.json"
        if path.is_file():
            with contextlib.suppress(InputError):  # the case says what is wrong with it
                return read_world(path)
    return None


def _trials(judged: Sequence[TrialRecord], floor: World | None) -> Trials:
    places = np.array(
        [[r.descriptors.get("x", 0.5), r.descriptors.get("y", 0.5)] for r in judged]
    ).reshape(-1, 2)
    if floor is not None:
        places = floor.bounds[:2] + places * (floor.bounds[2:] - floor.bounds[:2])
    return Trials(
        numbers=tuple(record.number for record in judged),
        scores=tuple(record.score for record in judged),
        failed=tuple(record.failed for record in judged),
        places=places,
    )


# --- cases ---------------------------------------------------------------------------------


def _readable_cases(campaign: Campaign) -> tuple[list[Case], list[str]]:
    """Cases to show, and a sentence for each whose files are missing or damaged."""
    cases, lost = [], []
    for record in chosen_cases(campaign):
        try:
            cases.append(case_of(campaign, record))
        except InputError as error:
            lost.append(f"Trial {record.id} is not shown in full: {error}.")
        except (AttributeError, KeyError, TypeError) as error:
            folder = campaign.folder(record)
            lost.append(
                f"Trial {record.id} is not shown in full: a file in {folder} is damaged ({error})."
            )
    return cases, lost


def case_of(campaign: Campaign, record: TrialRecord) -> Case:
    """A stored failure as the report shows it.

    Raises:
        FormatError: its files are damaged.
    """
    folder = campaign.folder(record)
    config = campaign.settings.trials.stack
    if record.engine != config.engine.name:
        config = quick_stack(config)
    minimised = _minimised(campaign, record, config)
    return Case(
        id=record.id,
        signature=record.signature,
        world=(world := read_world(folder / "world.json")),
        trace=read_trace(folder / "trace.zip"),
        verdicts=in_order(record.verdicts),
        costmap=costmap_of(world, config),
        facts=_case_facts(campaign, record),
        commands=commands_of(campaign, record),
        layer=_stored(folder / "explain.json").get("layer", "") or record.layer,
        removed=minimised[0],
        minimised=minimised[1],
        **_evidence(folder),
    )


def _evidence(folder: Path) -> dict[str, Any]:
    """What `replay --verify` and `explain` have stored about a trial."""
    verified, explained = _stored(folder / "verify.json"), _stored(folder / "explain.json")
    family = _stored(folder / "family.json")
    found: dict[str, Any] = {
        "counterfactuals": tuple(
            Counterfactual(
                change=row["change"], failure_gone=row["failure_gone"], detail=row["detail"]
            )
            for row in explained.get("counterfactuals", [])
        ),
        "neighbours": tuple(explained.get("neighbours", [])),
    }
    if family:
        found["family"] = tuple(row["text"] for row in family["conditions"])
        found["family_precision"] = family["sentence"]
    if verified:
        found["identical"] = (verified["identical"], verified["runs"])
    if explained.get("jittered"):
        found["jittered"] = (explained["jittered"]["failed"], explained["jittered"]["runs"])
    return found


def _stored(path: Path) -> dict[str, Any]:
    data = codec.read_json(path) if path.is_file() else {}
    return data if isinstance(data, dict) else {}


def _minimised(
    campaign: Campaign, record: TrialRecord, config: StackConfig
) -> tuple[tuple[str, ...], Case | None]:
    folder = campaign.folder(record)
    found = _stored(folder / "minimize.json")
    if not found or not (folder / "world.min.json").is_file():
        return (), None
    world = read_world(folder / "world.min.json")
    verdicts = codec.decode(_Verdicts, {"verdicts": found["verdicts"]}, where="minimize.json")
    case = Case(
        id=f"{record.id}, minimised",
        signature=found["signature"],
        world=world,
        trace=read_trace(folder / "trace.min.zip"),
        verdicts=in_order(verdicts.verdicts),
        costmap=costmap_of(world, config),
        facts=(("world digest", world.digest()[:16]), ("runs used", str(found["runs"]))),
        commands=_minimised_commands(folder),
    )
    return tuple(found["removed"]), case


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


def in_order(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """The verdict that explains the run first, its consequences after it."""
    rank = {name: i for i, name in enumerate(PRECEDENCE)}
    return tuple(sorted(verdicts, key=lambda v: (not v.violated, rank.get(v.spec, -1), v.spec)))


def _case_facts(campaign: Campaign, record: TrialRecord) -> tuple[tuple[str, str], ...]:
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
    return (
        (
            "Run the trial again and compare digests",
            shlex.join(["mrta-falsify", "replay", *where, "--verify", "3"]),
        ),
        (
            "Ask which layer is to blame",
            shlex.join(["mrta-falsify", "explain", *where]),
        ),
        (
            "Find the smallest world that fails in the same way",
            shlex.join(["mrta-falsify", "minimize", *where]),
        ),
        (
            "Find the rule behind it: which dimensions matter, and how far they may move",
            shlex.join(["mrta-falsify", "family", *where]),
        ),
        (
            "Run its world on its own, with your stack",
            shlex.join(["mrta-falsify", "run", str(world), "--stack", "my_stack.yaml"]),
        ),
    )


def comparison_table(campaign: Campaign, against: Campaign) -> Table:
    """Two campaigns side by side, mode by mode."""
    one = {mode["signature"]: mode["count"] for mode in modes(campaign)}
    other = {mode["signature"]: mode["count"] for mode in modes(against)}
    counts = [sum(record.status == "ok" for record in c.records) for c in (campaign, against)]
    rows = [
        (name, f"{one.get(name, 0)}", f"{other.get(name, 0)}")
        for name in sorted(one.keys() | other)
    ]
    total = (f"{sum(one.values())} of {counts[0]}", f"{sum(other.values())} of {counts[1]}")
    return Table(
        title="Against another stack",
        columns=("mode", str(campaign.directory), str(against.directory)),
        rows=(*rows, ("all failures", *total)),
    )


# --- other formats -------------------------------------------------------------------------


def markdown(campaign: Campaign) -> str:
    """The report as Markdown: modes, one case each, commands."""
    report = report_of(campaign)
    lines = [f"# {report.title}", "", report.headline + ".", ""]
    lines += [f"- {label}: {text}" for label, text in report.facts]
    lines += ["", *report.notes, ""]
    for number, mode in enumerate(report.modes, start=1):
        lines += [f"## Mode {number}: `{mode.signature}`", "", f"Trials: {', '.join(mode.ids)}", ""]
        for case in mode.cases[:1]:
            violated = [verdict for verdict in case.verdicts if verdict.violated]
            lines += [sentence(verdict) for verdict in violated[:1]]
            edges = violated[0].evidence.get("cycle", []) if violated else []
            lines += ["", *(f"- {edge_sentence(edge)}" for edge in edges)]
            if case.layer:
                lines += ["", f"Suspected layer: {case.layer}."]
            lines += ["", *(f"{what}: `{command}`  " for what, command in case.commands), ""]
    for name, text in report.errors:
        lines.append(f"- error of the toolkit in trial {name}: {text.splitlines()[-1]}")
    return "\n".join(lines).rstrip() + "\n"


def junit(campaign: Campaign) -> str:
    """The trials as JUnit XML: a failure is a violation, an error one of the toolkit."""
    judged = [record for record in campaign.records if record.status != "rejected"]
    suite = ET.Element(
        "testsuite",
        name=Path(campaign.settings.trials.scenario).stem,
        tests=str(len(judged)),
        failures=str(sum(record.failed for record in judged)),
        errors=str(sum(record.status in ("crashed", "timeout") for record in judged)),
        time=f"{sum(record.wall_s for record in judged):.3f}",
    )
    for record in judged:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=suite.get("name", ""),
            name=f"trial {record.id}",
            time=f"{record.wall_s:.3f}",
        )
        verdict = leading(record.verdicts)
        if verdict is not None:
            failure = ET.SubElement(
                case, "failure", type=record.signature, message=sentence(verdict)
            )
            failure.text = "\n".join(command for _, command in commands_of(campaign, record))
        elif record.status in ("crashed", "timeout"):
            lines = record.error.strip().splitlines() or [record.status]
            error = ET.SubElement(case, "error", type=record.status, message=lines[-1])
            error.text = record.error
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
