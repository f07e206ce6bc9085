"""The frozen suite is whole."""

from __future__ import annotations

import functools

import pytest

from experiments import holm
from experiments.falsification import suite
from experiments.falsification.pairs import HERE, SUITES, read_suite
from mrta_falsify.core.codec import digest
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.program import compile_program

PAIRS = {version: read_suite(version) for version in SUITES}
NAMED = [(version, name) for version, pairs in PAIRS.items() for name in pairs]


def worlds(version: str, name: str, count: int = 1):
    program = _program(PAIRS[version][name].path)
    return [program.realise(program.candidate(number)).world for number in range(count)]


@functools.cache
def _program(path):
    return compile_program(path)


def test_there_are_at_least_ten_pairs_each_and_five_hard_ones():
    halves = [pair.half for pair in PAIRS["suite"].values()]
    assert len(halves) >= 10
    assert halves.count("hard") >= 5


@pytest.mark.parametrize(("version", "name"), NAMED)
def test_a_pair_names_layers_defects_and_specifications_that_exist(version, name):
    pair = PAIRS[version][name]
    assert pair.stack.engine.name == "kinematic"
    specifications, last = pair.judged_by
    build_specifications(specifications)
    assert set(last) < set(specifications)


def test_each_pair_of_the_suite_has_one_fault_and_late_work_is_none_of_its_failures():
    pairs = PAIRS["suite"].values()
    assert all(len(pair.defects) + len(pair.settings) == 1 for pair in pairs)
    assert len({(*pair.defects, *pair.settings) for pair in pairs}) >= 6
    assert all("deadlines" in pair.judged_by[1] for pair in pairs)


def test_no_pair_of_the_tuning_set_is_in_a_suite():
    tuning = {(pair.scenario, pair.defects, pair.settings) for pair in PAIRS["tuning"].values()}
    frozen = PAIRS["suite"].values()
    assert tuning.isdisjoint((pair.scenario, pair.defects, pair.settings) for pair in frozen)


@pytest.mark.slow
def test_the_suite_has_the_worlds_it_promises():
    found = {name: worlds("suite", name, 2) for name in PAIRS["suite"]}
    first = {name: two[0] for name, two in found.items()}
    on_aws = [w for w in first.values() if "day_surgery" in {room.name for room in w.rooms}]
    assert sum(len(w.robots) == 6 and len(w.humans) == 8 for w in on_aws) >= 4
    assert sum(len(w.robots) >= 12 for w in first.values()) >= 2
    assert sum(w.horizon > 180.0 for w in first.values()) <= 2
    walls = [[digest(world.walls) for world in two] for two in found.values()]
    assert sum(one != other for one, other in walls) >= 2
    kinds = [{resource.kind for resource in w.resources} for w in first.values()]
    assert sum(bool(of & {"door", "elevator", "charger"}) for of in kinds) >= 2


def test_every_scenario_file_is_of_some_pair():
    files = {path.stem for path in (HERE / "scenarios").glob("*.scenic")}
    assert files == {pair.scenario for pairs in PAIRS.values() for pair in pairs.values()}


def test_a_directory_of_other_searches_is_one_sentence_and_exit_code_2(
    tmp_path, monkeypatch, capsys
):
    mark = tmp_path / "searches/two_doors/comparison.json"
    mark.parent.mkdir(parents=True)
    mark.write_text("{}")
    monkeypatch.setattr("sys.argv", ["suite", "search", str(tmp_path), "--pairs", "two_doors"])
    with pytest.raises(SystemExit) as exited:
        suite.main()
    assert exited.value.code == 2
    assert "compares samplers with other" in capsys.readouterr().err


def test_p_values_are_corrected_for_how_many_there_are():
    assert holm.adjusted([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm.adjusted([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm.adjusted([]) == []
