"""Mutants in processes of their own: killed, alive or hanging, and the sound stack untouched."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.defects.worlds import PLANTS
from benchmarks.mutation import bench as benches
from benchmarks.mutation.bench import Bench, trial_of
from benchmarks.mutation.killing import hunt
from benchmarks.mutation.layers import layer_of
from benchmarks.mutation.mutants import Edit, Mutant
from benchmarks.mutation.process import StoppedError
from benchmarks.mutation.runs import reasons
from benchmarks.mutation.sound import SoundRuns
from benchmarks.mutation.trees import sound_tree
from benchmarks.mutation.worlds import Case, mutation_specifications, read_cases, write_cases
from mrta_falsify.core import codec

pytestmark = pytest.mark.long  # compiles the kernels in a copy of the sources

ROOT = Path(__file__).resolve().parents[2]
ITINERARY = "mrta_falsify/stack/itinerary.py"
INFLATION = "simulator_interface/inflation.py"
PRICE = "            cost[row + r, col + c] = prices[nearest[c]]"
WORLD = PLANTS["same_room_twice_stalls"].world(0)


def mutant(name: str, path: str, before: str, after: str) -> Mutant:
    """A mutant of a line that occurs once."""
    lines = (ROOT / path).read_text(encoding="utf-8").split("\n")
    (line,) = (number for number, text in enumerate(lines, start=1) if text == before)
    edit = Edit(path=path, line=line, before=before, after=after)
    return Mutant(id=name, edits=(edit,), layer=layer_of(path), what=f"{before} -> {after}")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    directory = tmp_path_factory.mktemp("mutation")
    case = Case(name="stops", source="corpus", settings=(), data=codec.encode(WORLD))
    write_cases([case], directory / "worlds.json.gz")
    specifications = mutation_specifications()
    return Bench(
        directory=directory,
        cases=read_cases(directory / "worlds.json.gz"),
        sound=SoundRuns(directory / "sound.jsonl", specifications),
    )


@pytest.fixture(scope="module")
def sound(bench):
    with bench.sound_process() as process:
        yield process


@pytest.fixture
def run_of(bench, sound):
    """The run of a mutant in the one world."""

    def run(made: Mutant):
        with trial_of(bench, made, sound, []) as trial:
            trial.sound(WORLD, bench.cases[0].stack)
            return trial.run(WORLD, bench.cases[0].stack)

    return run


def compiled_files(bench) -> set[str]:
    tree = sound_tree(bench.trees)
    return {str(file) for file in tree.rglob("*.nb[ci]")}


def sound_run(bench, process, journal: Path):
    """What the sound stack does now, whatever is remembered."""
    again = SoundRuns(journal, bench.sound.specifications)
    return again.run(process, WORLD, bench.cases[0].stack)


def test_a_known_mutant_is_killed_by_the_copies(bench, sound):
    before = "        stop, rest = mission.itinerary[0], mission.itinerary[1:]"
    made = mutant("forgets", ITINERARY, before, before.replace("[1:]", "[2:]"))
    found = hunt(bench, made, sound, [])
    assert (found.status, found.kind, found.case) == ("killable", "behaviour", "stops")
    assert set(found.why) & {"all_tasks_done", "deadlines", "progress", "honest_events"}
    assert found.copies == "3 of 3 copies, the sound stack 0 of 3"
    assert found.runs == 4


def test_an_equivalent_mutant_survives_and_leaves_every_trace_as_it_is(bench, sound):
    before = "        if not mission.itinerary:\n            return time"
    text = (ROOT / ITINERARY).read_text(encoding="utf-8")
    line = text[: text.index(before)].count("\n") + 1
    after = before.replace("not mission.itinerary", "len(mission.itinerary) <= 0")
    edit = Edit(path=ITINERARY, line=line, before=before, after=after)
    found = hunt(bench, Mutant(id="same", edits=(edit,)), sound, [])
    assert (found.status, found.worlds, found.differing) == ("survived", 1, 0)
    assert not (bench.trees / "same").exists()


def test_a_mutant_is_not_run_where_its_lines_are_not_reached(bench, sound):
    before = "            service += NO_PATH_DELAY"
    made = mutant("unreached", ITINERARY, before, before.replace("+=", "-="))
    found = hunt(bench, made, sound, [])
    assert (found.status, found.runs) == ("unreached", 0)


def test_a_stale_mutant_is_named_and_not_run(bench, sound):
    edit = Edit(path=ITINERARY, line=1, before="nothing of the kind", after="")
    found = hunt(bench, Mutant(id="old", edits=(edit,)), sound, [])
    assert found.status == "stale"
    assert "mutant old" in found.error


def test_compiled_code_is_mutated_in_the_mutant_and_nowhere_else(bench, sound, run_of, tmp_path):
    before = sound_run(bench, sound, tmp_path / "a").digest
    files = compiled_files(bench)
    found = run_of(mutant("dear", INFLATION, PRICE, PRICE.replace("]]", "] // 2]")))
    assert found.fate == "judged"
    assert found.compile_s > 0.0
    assert found.digest != before
    assert compiled_files(bench) == files
    with bench.sound_process() as fresh:
        assert sound_run(bench, fresh, tmp_path / "b").digest == before


def test_a_hang_in_compiled_code_is_ended(run_of, monkeypatch):
    monkeypatch.setattr(benches, "HANGS_AFTER", 2.0)
    monkeypatch.setattr(benches, "TIMES_SOUND", 0.5)
    endless = f"            while True:\n                pass\n{PRICE}"
    assert reasons(run_of(mutant("endless", INFLATION, PRICE, endless))) == ("hang",)


@pytest.mark.parametrize(
    ("name", "after"), [("import", "1 / 0"), ("syntax", "("), ("memory", "x = [0] * 10**11")]
)
def test_a_mutant_that_cannot_be_imported_crashes(run_of, name, after):
    before = "AT_REST = 0.1  # m/s, slow enough to load and unload"
    found = run_of(mutant(name, ITINERARY, before, f"{before}\n{after}"))
    assert found.fate == "crash"
    assert any(word in found.error for word in ("ZeroDivision", "SyntaxError", "MemoryError"))


def test_an_interruption_ends_a_process_at_once(bench):
    with bench.sound_process() as process:
        process.stopped = True
        with pytest.raises(StoppedError):
            process.run(bench.cases[0].data, bench.cases[0].stack, (), cpu_s=300.0)


def test_the_sound_stack_runs_once_for_all_mutants(bench, sound):
    case = bench.cases[0]
    first = bench.sound.run(sound, case.world, case.stack, lines=True)
    assert first.lines[ITINERARY]
    again = SoundRuns(bench.directory / "sound.jsonl", bench.sound.specifications)
    assert again.run(None, case.world, case.stack, lines=True) == first
