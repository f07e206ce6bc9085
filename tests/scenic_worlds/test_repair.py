"""From a candidate to an accepted scene, and back from the scene's own coordinates."""

from __future__ import annotations

import random

import numpy as np
import pytest
from scipy.stats import ks_2samp

from mrta_falsify.core.candidate import Candidate
from scenic_worlds.program import Program

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

WARDS = """
from scenic_worlds.floors import hospital
param layout = hospital(rooms=6, station=False)
model scenic_worlds.model
for i in range(2):
    new Robot with start_room i, with name f'robot{i + 1}'
KINDS
new Human with route random_route(2), with name 'guest', with speed Range(0.5, 1.5)
param tasks = [(Range(0, 100), 0, 1, Range(80, 200)) for _ in range(3)]
"""
CROWDED = WARDS.replace(
    "KINDS",
    """
for i in range(8):
    new Bed in room(i % 4), facing Range(0, 360) deg, with name f'bed{i + 1}'
bed = new Bed in room(5), facing 0 deg, with name 'corner'
new BedsideCabinet in beside(bed), with name 'bedside'
""",
)
PAIR = WARDS.replace(
    "KINDS",
    """
a = new Chair in room(0), with name 'a'
b = new Chair in room(0), with name 'b'
require distance from a to b < 1.2
""",
)


def compiled(text: str, folder, **options) -> Program:
    from scenic_worlds.program import compile_program

    path = folder / "program.scenic"
    path.write_text(text)
    return compile_program(path, **options)


@pytest.fixture(scope="module")
def crowded(tmp_path_factory) -> Program:
    return compiled(CROWDED, tmp_path_factory.mktemp("crowded"))


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> Program:
    return compiled(PAIR, tmp_path_factory.mktemp("pair"))


def names_of(program: Program) -> list[str]:
    return [dimension.name for dimension in program.space.dimensions]


@pytest.mark.parametrize("mode", ["repair", "exact"])
@pytest.mark.parametrize("name", ["crowded", "pair"])
def test_what_comes_out_gives_the_scene_by_itself(name, mode, request):
    program = request.getfixturevalue(name)
    for number in range(3):
        if (name, mode) == ("crowded", "exact"):
            asked = program.realise(program.candidate(5, number)).candidate
        else:
            asked = program.candidate(5, number)
        found = program.realise(asked, mode)
        for again_mode in ("exact", "repair"):
            again = program.realise(found.candidate, again_mode)
            assert again.attempts == 1
            assert again.world.digest() == found.world.digest()
            np.testing.assert_array_equal(again.candidate.u, found.candidate.u)


def test_repaired_scenes_are_accepted_by_scenics_own_checker(crowded):
    from scenic.core.sample_checking import BasicChecker

    checker = BasicChecker(initialCollisionCheck=False)
    checker.setRequirements(
        crowded.scenario.defaultRequirements + crowded.scenario.userRequirements
    )
    repaired = 0
    for number in range(8):
        found = crowded.realise(crowded.candidate(1, number))
        repaired += found.attempts > 1
        assert checker.checkRequirements(found.scene.sample) is None
    assert repaired >= 5


def test_repair_changes_only_what_places_the_objects_to_blame(crowded):
    names = names_of(crowded)
    moved = set()
    for number in range(6):
        asked = crowded.candidate(2, number)
        found = crowded.realise(asked)
        changed = [n for n, a, b in zip(names, asked.u, found.candidate.u, strict=True) if a != b]
        places = [n for n in changed if not n.startswith("tasks")]
        moved |= {n.partition(".")[0] for n in places}
        assert all(n.partition(".")[2].startswith(("position", "yaw")) for n in places), places
        blamed = " ".join(found.rejections)
        assert all(n.partition(".")[0] in blamed for n in places)
    assert "guest" not in moved
    assert len(moved) >= 4


def test_places_are_drawn_in_batches_as_if_one_at_a_time(crowded, monkeypatch):
    from scenic_worlds import placing as settling

    assert sum(settling.BATCHES) == 60
    together = [crowded.realise(crowded.candidate(3, number)) for number in range(6)]
    monkeypatch.setattr(settling, "BATCHES", (1,) * 60)
    apart = [crowded.realise(crowded.candidate(3, number)) for number in range(6)]
    for a, b in zip(together, apart, strict=True):
        assert a.world.digest() == b.world.digest()
        assert (a.attempts, a.rejections) == (b.attempts, b.rejections)
    assert max(sum(found.rejections.values()) for found in together) > 10


def test_a_deadline_before_its_arrival_is_a_rejected_scene(pair):
    k = len(pair.space)
    u = np.full(k, 0.5)
    names = names_of(pair)
    late = names.index("tasks[1][0]"), names.index("tasks[1][3]")
    asked = pair.realise(Candidate(number=0, u=u, seed=3)).candidate
    u = asked.u.copy()
    u[late[0]], u[late[1]] = 0.99, 0.01
    found = pair.realise(Candidate(number=0, u=u, seed=4))
    assert found.attempts > 1
    assert any("before its arrival" in who for who in found.rejections)
    task = found.world.tasks[1]
    assert task.arrival <= task.deadline
    changed = {n for n, a, b in zip(names, u, found.candidate.u, strict=True) if a != b}
    assert changed == {"tasks[1][0]", "tasks[1][3]"}


def test_whole_scene_rejection_keeps_scenics_conditional_distribution(tmp_path):
    import scenic

    text = """
class Box(Object):
    kind: 'box'
    requireVisible: False
    regionContainedIn: everywhere
workspace = Workspace(everywhere)
a = new Box at (Range(0, 4), Range(0, 4)), facing Range(0, 90) deg, with width 2, with length 1
b = new Box at (Range(0, 4), Range(0, 4)), with width Uniform(1, 2), with length 2
require a.position.x < b.position.x + 1
"""
    from scenic_worlds.checking import FastChecker
    from scenic_worlds.primitives.driver import Driver
    from scenic_worlds.repair import SceneSearch

    driver = Driver(scenic.scenarioFromString(text))
    checker = FastChecker()
    driver.scenario.setSampleChecker(checker)
    search = SceneSearch(driver, checker, "boxes")
    things = list(driver.names)

    def row(values, things):
        a, b = (values[thing] for thing in things)
        return [a.position.x, a.position.y, a.heading, b.position.x, b.position.y, b.width]

    draws = np.random.default_rng(4)
    ours = []
    for seed in range(250):
        found = search.exact(draws.random(len(driver.space)), seed, lambda values: values)
        ours.append(row(found.value, things))
    scenario = scenic.scenarioFromString(text)
    state = random.getstate()
    random.seed(3)
    scenes = [scenario.generate()[0] for _ in range(250)]
    random.setstate(state)
    theirs = [row(scene.sample, scenario.objects) for scene in scenes]
    for column, (a, b) in enumerate(zip(np.transpose(ours), np.transpose(theirs), strict=True)):
        assert ks_2samp(a, b).pvalue > 1e-3 / 6, column


def test_a_requirement_that_nothing_random_can_meet_is_given_up_at_once(tmp_path):
    from scenic_worlds.repair import RejectedScene

    text = WARDS.replace("KINDS", "limit = 900\nrequire limit < 100")
    program = compiled(text, tmp_path)
    with pytest.raises(RejectedScene, match=r"program\.scenic:.*does not depend on anything") as e:
        program.realise(program.candidate(0))
    assert e.value.attempts == 1


@pytest.mark.parametrize("mode", ["repair", "exact"])
def test_when_nothing_is_found_the_error_says_who_rejected_how_often(pair, mode):
    from scenic_worlds.repair import RejectedScene

    with pytest.raises(RejectedScene) as caught:
        pair.realise(_far_apart(pair), mode, max_attempts=1)
    assert "no scene accepted in 1 attempt. Rejected by: program.scenic:" in str(caught.value)
    assert "(1 times)" in str(caught.value)
    assert list(caught.value.rejections.values()) == [1]


def _far_apart(program: Program) -> Candidate:
    """A candidate whose chairs stand apart, and nothing else is wrong."""
    names = names_of(program)
    u = program.realise(program.candidate(9)).candidate.u.copy()
    for name, value in (("a.position.0", 0.05), ("b.position.0", 0.95)):
        u[names.index(name)] = value
    return Candidate(number=0, u=u, seed=1)


def test_the_same_candidate_is_repaired_in_the_same_way(crowded):
    first, second = (crowded.realise(crowded.candidate(8, 3)) for _ in range(2))
    assert first.world.digest() == second.world.digest()
    assert first.rejections == second.rejections
    other = crowded.candidate(8, 3)
    moved = crowded.realise(Candidate(number=3, u=other.u, seed=other.seed + 1))
    assert moved.world.digest() != first.world.digest()


def test_sampling_leaves_the_global_generators_alone(crowded):
    before = random.getstate(), np.random.get_state()[1].tobytes()  # noqa: NPY002
    crowded.realise(crowded.candidate(3))
    assert (random.getstate(), np.random.get_state()[1].tobytes()) == before  # noqa: NPY002


def test_soft_requirements_hold_with_their_probability_and_by_seed(tmp_path):
    text = WARDS.replace("KINDS", "x = Range(0, 1)\nparam x = x\nrequire[0.7] x < 0.2")
    program = compiled(text, tmp_path)
    where = names_of(program).index("param x")
    u = program.candidate(0).u.copy()
    u[where] = 0.9
    kept = 0
    for seed in range(60):
        found = program.realise(Candidate(number=0, u=u, seed=seed))
        again = program.realise(Candidate(number=0, u=u, seed=seed))
        assert (again.candidate.u == found.candidate.u).all()
        kept += found.candidate.u[where] == 0.9
    assert 6 <= kept <= 32  # 0.3 of 60, four standard deviations either way


def test_random_numbers_that_a_function_draws_on_its_own_depend_on_the_seed_only(tmp_path):
    text = """
import random
from scenic.core.distributions import distributionFunction
@distributionFunction
def shaken(x):
    return x + random.random()
""" + WARDS.replace("KINDS", "new Bed in room(2), facing shaken(Range(0, 6)), with name 'bed'")
    program = compiled(text, tmp_path)
    for number in range(4):
        found = program.realise(program.candidate(1, number))
        again = program.realise(found.candidate, "exact")
        assert (again.attempts, again.world.digest()) == (1, found.world.digest())
