"""docs/gallery: real failures, made again, minimised, explained and drawn.

    python -m tools.draw_gallery WORK [--only NAME ...] [--workers 1]

Each case of docs/gallery/cases.yaml says which campaign found it. The campaign is run up to the
trial in WORK/NAME (a campaign that is there already is used), the failure is replayed, explained
and minimised as by the commands that the page shows, and the page, a picture and the smallest
world are written to docs/gallery. A second call goes on.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import shlex
import shutil
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.analysis.explain import explain, removal_text
from mrta_falsify.analysis.minimize import minimize
from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import SETTINGS, Campaign, StoreError
from mrta_falsify.commands.campaign import open_store, run_store
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.replay import replay_trial, store_replay
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.workers import local_workers
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig, apply_setting
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.task_history import stories, tasks_of
from reports.sentences import account_sentences, violation_sentence
from tools.draw_failure import seen_in
from tools.gallery_pictures import Seen, write_picture

FOLDER = Path(__file__).parent.parent / "docs" / "gallery"
CASES = FOLDER / "cases.yaml"
WIDE = 100  # columns of the page
PAGE = FOLDER / "README.md"
MAX_RUNS = 100  # of the minimiser
PATIENCE = 3600.0  # s of wall clock for a trial, on a busy machine
FILES = ("world.min.scenic", "world.min.layout.json", "stack.yaml")

HEAD = """# Gallery

Failures that campaigns of this project have found, in the default stack and in stacks with a planted fault. Each was replayed three times with
equal digests, made as small as it gets, and asked for its cause by re-runs with one layer changed. Orange: furniture that the smallest world
still has. Red ring: where it happens; red arrows: who waits for whom; dashed: paths at that moment.

The page is written by `python -m tools.draw_gallery WORK` from [cases.yaml](cases.yaml). `runs/` stands for any new directory; the smallest worlds
are kept here and run in seconds.

| Failure | Scenario | Stack | Violated | Suspected layer | As found | Smallest |
|---|---|---|---|---|---|---|
"""  # noqa: E501


@dataclass(frozen=True, slots=True, kw_only=True)
class GalleryCase:
    """A failure of the gallery, and the campaign that finds it."""

    name: str  #: of its files
    title: str
    scenario: str
    sampler: str
    seed: int
    trial: int
    why: str  #: a person's explanation
    since: str = ""  #: why the smallest world passes by now
    params: dict[str, Any] = dataclasses.field(default_factory=dict)
    settings: tuple[str, ...] = ()  #: of the stack, as of ``--set``
    specifications: tuple[str, ...] = ()  #: those of campaigns if empty

    def words(self) -> list[str]:
        """List the words of the command that runs the campaign, without its output."""
        words = ["mrta-falsify", "campaign", self.scenario, "--sampler", self.sampler]
        words += ["--seed", str(self.seed), "--budget", str(self.trial + 1)]
        for setting in self.settings:
            words += ["--set", setting]
        for name in self.specifications:
            words += ["--spec", name]
        for name, value in sorted(self.params.items()):
            words += ["-p", f"{name}={value}"]
        return words

    def config(self) -> StackConfig:
        """Build the stack under test."""
        config = StackConfig()
        for setting in self.settings:
            config = apply_setting(config, setting)
        return config


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CaseText:
    """All that the page says of a case."""

    case: GalleryCase
    original: Seen
    smallest: Seen
    explanation: Explanation
    verified: ReplayCheck
    minimised: Minimisation


def read_cases(path: Path = CASES) -> list[GalleryCase]:
    """Read the list of cases.

    Raises:
        InputError: not such a list.
    """
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    return [codec.decode(GalleryCase, row, where=f"{path.name}[{i}]") for i, row in enumerate(data)]


def found_again(case: GalleryCase, directory: Path, workers: int) -> Campaign:
    """Run the campaign of a case up to its trial, or open it if it was run before.

    Raises:
        StoreError: the directory holds another campaign.
    """
    if (directory / SETTINGS).is_file():
        campaign = open_campaign(directory)
        trials = campaign.settings.trials
        there = (Path(trials.scenario).stem, trials.seed, trials.stack, trials.params)
        wanted = (Path(case.scenario).stem, case.seed, case.config(), case.params)
        if there != wanted or campaign.settings.sampler.name != case.sampler:
            raise StoreError(f"{directory}: holds another campaign than {case.name}")
        if any(record.number == case.trial for record in campaign.records):
            return campaign
    settings = new_settings(
        case.scenario,
        output=directory,
        stack=case.config(),
        params=case.params,
        sampler=Choice(case.sampler),
        seed=case.seed,
        specs=case.specifications,
        time_limit=PATIENCE,
    )
    with open_store(directory, settings) as store:
        executor = local_workers(workers)
        return run_store(store, Limits(budget=case.trial + 1), executor).campaign


def told(case: GalleryCase, campaign: Campaign, record: TrialRecord) -> CaseText:
    """Gather everything about a case; what is kept beside the trial is not computed again."""
    folder = campaign.folder(record)
    verified = read_finding(folder, ReplayCheck)
    if verified is None:
        verified = store_replay(campaign, replay_trial(campaign, record, times=3))
    if verified.identical != verified.runs:
        raise InputError(f"{case.name}: its replay differs; delete its campaign in WORK")
    small = read_finding(folder, Minimisation) or minimize(campaign, record, max_runs=MAX_RUNS)
    explanation = read_finding(folder, Explanation) or explain(campaign, record)
    original, smallest = seen_in(folder, record.verdicts, small.verdicts)
    return CaseText(
        case=case,
        original=original,
        smallest=smallest,
        explanation=explanation,
        verified=verified,
        minimised=small,
    )


def keep_files(campaign: Campaign, record: TrialRecord, folder: Path) -> None:
    """Copy the smallest world and its stack, to be run from the gallery."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        source = campaign.folder(record) / name
        (folder / name).unlink(missing_ok=True)
        if source.is_file():
            shutil.copyfile(source, folder / name)


# --- the page ------------------------------------------------------------------------------


def row_of(found: CaseText) -> str:
    """Write the case's line in the table of contents."""
    case = found.case
    anchor = "".join(c for c in case.title.lower() if c.isalnum() or c in " -").replace(" ", "-")
    defects = ", ".join(f"`{name}`" for name in case.config().defects)
    cells = [
        f"[{case.title}](#{anchor})",
        f"`{Path(case.scenario).stem}`",
        defects or "default",
        f"`{found.original.verdict.spec}`",
        _spaced(found.explanation.layer),
        _size(found.original),
        _size(found.smallest),
    ]
    return "| " + " | ".join(cells) + " |\n"


def _size(seen: Seen) -> str:
    return f"{len(seen.world.robots)} robots, {len(seen.world.tasks)} tasks".replace(
        "1 robots", "1 robot"
    ).replace(" 1 tasks", " 1 task")


def _spaced(text: str) -> str:
    return text.replace("_", " ")


def section(found: CaseText) -> str:
    """Write the case's part of the page."""
    case = found.case
    parts = [
        f"## {case.title}",
        f"![{case.title}: as found, at its smallest, and who waits for whom]({case.name}.png)",
        f"**What happened.** {' '.join(what_happened(found.original))}",
        f"**Why.** {' '.join(case.why.split())}",
        *([f"**Since then.** {' '.join(case.since.split())}"] if case.since else []),
        _counts(found),
        _layer(found),
        "**Again.**\n\n```\n" + "\n".join(commands(case)) + "\n```",
    ]
    return "\n\n".join(parts) + "\n"


def what_happened(seen: Seen) -> list[str]:
    """Tell what happened in a failing run, in sentences."""
    verdict = seen.verdict
    return [
        violation_sentence(verdict),
        *account_sentences(seen.account),
        *stories(tasks_of(verdict), seen.world, seen.trace),
    ]


def _counts(found: CaseText) -> str:
    lines = ["| | as found | smallest |", "|---|---|---|"]
    for name in ("robots", "tasks", "humans", "furniture", "events"):
        before, after = found.minimised.counts[name]
        if before:
            lines.append(f"| {'people' if name == 'humans' else name} | {before} | {after} |")
    horizons = [f"{seen.trace.duration:.0f} s" for seen in (found.original, found.smallest)]
    lines.append(f"| length of the run | {horizons[0]} | {horizons[1]} |")
    minimal = "nothing of it can go" if found.minimised.one_minimal else "out of runs"
    lines.append("")
    lines.append(
        f"Found in {found.minimised.runs} runs; {minimal}. What went: "
        f"{', '.join(found.minimised.removed) or 'nothing'}."
    )
    return "\n".join(lines)


def _layer(found: CaseText) -> str:
    explanation = found.explanation
    text = f"**Suspected layer: {_spaced(explanation.layer) or 'none'}.** "
    text += f"{explanation.reason[:1].upper()}{explanation.reason[1:]} "
    text += f"(runs that differ from {explanation.changed_at:.0f} s on)."
    if explanation.guess and explanation.guess != explanation.layer:
        text += f" The trace alone points to: {_spaced(explanation.guess)}."
    jittered = explanation.jittered
    if jittered.runs:
        text += f" With small differences it fails in {jittered.failed} of {jittered.runs}"
        text += " runs."
    text += f" Replay: {found.verified.identical} of {found.verified.runs} identical."
    rows = [
        f"| {row.change} | {'gone' if row.failure_gone else 'stays'} | {row.detail} |"
        for row in explanation.counterfactuals
    ]
    lines = [text]
    if rows:
        lines += ["", "| Changed | Failure | Then |", "|---|---|---|", *rows]
    for removal in explanation.removals:
        said = removal_text(removal)
        lines += ["", f"{said[:1].upper()}{said[1:]}."]
    return "\n".join(lines)


def commands(case: GalleryCase) -> list[str]:
    """List the commands that show all of it again."""
    runs = f"runs/{case.name}"
    trial = f"{case.trial:04d}"
    rows = [
        [*case.words(), "-o", runs],
        ["mrta-falsify", "replay", runs, trial, "--verify", "3"],
        ["mrta-falsify", "explain", runs, trial],
        ["mrta-falsify", "minimize", runs, trial],
        ["mrta-falsify", "report", runs],
    ]
    kept = FOLDER / case.name
    if (kept / FILES[0]).is_file():
        here = f"docs/gallery/{case.name}"
        world = f"{here}/{FILES[0]}"
        rows.append(["mrta-falsify", "run", world, "--stack", f"{here}/{FILES[2]}", "-o", "out"])
    return [on_lines(words) for words in rows]


def on_lines(words: list[str]) -> str:
    """Join a command, broken before options where it is wider than the page."""
    lines = [""]
    quoted = [shlex.quote(word) for word in words]
    for i, word in enumerate(quoted):
        wanted = len(word) + (len(quoted[i + 1]) + 1 if quoted[i + 1 :] else 0)
        if word.startswith("-") and len(lines[-1]) + 1 + wanted > WIDE - 2:
            lines[-1] += " \\"
            lines.append("   ")
        lines[-1] += (" " if lines[-1] else "") + word
    return "\n".join(lines)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path, help="for the campaigns")
    parser.add_argument("--only", nargs="*", help="make these; the others stay as they are")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    before = PAGE.read_text(encoding="utf-8")
    page, sections = HEAD, []
    for case in read_cases():
        directory = arguments.work / case.name
        if arguments.only and case.name not in arguments.only:
            row, part = kept(before, case)
            page += row
            sections.append(part)
            continue
        campaign = found_again(case, directory, arguments.workers)
        record = campaign.record(str(case.trial))
        found = told(case, campaign, record)
        keep_files(campaign, record, FOLDER / case.name)
        write_picture(found.original, found.smallest, FOLDER / f"{case.name}.png")
        page += row_of(found)
        sections.append(section(found))
        summary = {"case": case.name, "signature": record.signature}
        print(json.dumps(summary), file=sys.stdout, flush=True)
    PAGE.write_text(in_columns(page + "\n" + "\n".join(sections)), encoding="utf-8")


def kept(page: str, case: GalleryCase) -> tuple[str, str]:
    """Find a case's line in the table, and its part, in the page as it is."""
    rows = [line for line in page.splitlines(keepends=True) if line.startswith(f"| [{case.title}]")]
    parts = re.findall(
        rf"^## {re.escape(case.title)}\n.*?(?=^## |\Z)", page, re.DOTALL | re.MULTILINE
    )
    (row,), (part,) = rows, parts
    return row, part.rstrip("\n") + "\n"


def in_columns(page: str) -> str:
    """Break the paragraphs of a page; headings, tables, pictures and commands stay."""
    blocks = page.split("\n\n")
    prose = [not re.match(r"[#|!`\n]|mrta-falsify", block) for block in blocks]
    return "\n\n".join(
        textwrap.fill(block, WIDE, break_long_words=False, break_on_hyphens=False)
        if plain
        else block
        for block, plain in zip(blocks, prose, strict=True)
    )


if __name__ == "__main__":
    main()
