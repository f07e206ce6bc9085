"""From one failure to the rule behind it, on a failure whose rule is known."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.interruption import Interrupted
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import quick_stack
from mrta_falsify.verbs.family import finding as family
from mrta_falsify.verbs.family import samples as family_runs
from mrta_falsify.verbs.family.finding import find_family
from mrta_falsify.verbs.family.peeling import peeled_box
from scenic_worlds.program import compile_program

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

PROGRAM = """
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0, with max_speed Range(0.5, 1.5)
new Human with name 'walker', with route [(5, -8), (5, 1)], with speed Range(0.5, 1.4)
new Trolley with name 'cart', at (Range(4, 6), Range(-12, -8))
param horizon = Range(100, 300)
param tasks = [(Range(0, 20), 0, Uniform(1, 2, 3), 400)]
"""
SIGNATURE = "progress"


def fails(world) -> bool:
    """Known rule: a fast walker, a cart in the west, and one of the three rooms."""
    cart = next(piece for piece in world.furniture if piece.name == "cart")
    is_west = cart.polygon[:, 0].mean() < 5.0
    return world.humans[0].speed > 1.1 and is_west and world.tasks[0].end == 2


def judged(job, *, keep_trace=True):
    failed = fails(job.world)
    verdict = Verdict(spec=SIGNATURE, violated=failed, robustness=-1.0 if failed else 1.0)
    return SimpleNamespace(verdicts=(verdict,))


@pytest.fixture
def case(tmp_path, monkeypatch):
    """A campaign of one failure, whose runs follow the known rule."""
    monkeypatch.setattr(family_runs, "judge", judged)
    path = tmp_path / "known.scenic"
    path.write_text(PROGRAM)
    program = compile_program(path)
    for number in range(200):
        realised = program.realise(program.candidate(3, number))
        if fails(realised.world):
            break
    settings = TrialSettings(scenario=str(path), stack=quick_stack(StackConfig()))
    record = TrialRecord(
        candidate=realised.candidate,
        status="ok",
        verdicts=(Verdict(spec=SIGNATURE, violated=True, robustness=-1.0),),
        signature=SIGNATURE,
        engine="kinematic",
    )
    folder = tmp_path / "trial"
    folder.mkdir()
    (folder / "world.json").write_text(_json(realised.world))
    campaign = SimpleNamespace(
        settings=SimpleNamespace(trials=settings),
        records=(record,),
        directory=tmp_path,
        folder=lambda record: folder,
    )
    return campaign, record, program


def _json(world) -> str:
    from mrta_falsify.core import codec

    return codec.canonical_json(world)


@pytest.mark.slow
def test_the_known_rule_is_found_and_its_program_samples_inside(case):
    campaign, record, program = case
    seen = []
    found = find_family(campaign, record, max_runs=260, fresh=60, on_run=seen.append)
    rule = {condition.dimension: condition for condition in found.conditions}
    kinds = {d.name: d for d in program.space.dimensions}
    ruling = {name for name in rule if name.startswith(("walker.speed", "cart.position.x"))}
    assert len(ruling) == 2
    room = set(rule) - ruling
    assert [kinds[name].kind for name in room] == ["choice"]
    assert rule[room.pop()].fate == "held"
    assert found.precision.estimate >= 0.9
    assert len(found.free) == len(program.space) - 3
    assert seen == list(range(1, len(seen) + 1))
    assert len(seen) <= 260
    assert "from" in rule["walker.speed"].text
    low, high = (0.5 + 0.9 * end for end in (rule["walker.speed"].low, rule["walker.speed"].high))
    assert low > 1.05
    assert high - low > 0.1

    inside = compile_program(Path(found.program))
    worlds = [inside.sample(seed) for seed in range(30)]
    assert np.mean([fails(world) for world in worlds]) >= 0.9
    assert len({world.humans[0].speed for world in worlds}) == 30
    assert np.mean([fails(program.sample(seed)) for seed in range(30)]) < 0.5
    stored = json.loads((campaign.folder(record) / "family.json").read_text())
    assert stored["precision"]["trials"] == 60
    assert stored["rule"] == list(found.rule)
    assert 1 <= len(found.passing) <= 3
    assert all("walker.speed = " in text or "cart.position.x" in text for text in found.passing)
    assert stored["sentence"] in (campaign.folder(record) / "family.scenic").read_text()


@pytest.mark.slow
def test_the_same_call_gives_the_same_family(case):
    campaign, record, _ = case
    first, second = (find_family(campaign, record, max_runs=60, fresh=10) for _ in range(2))
    assert first == second
    assert first.learning_runs + first.precision.trials <= 60


@pytest.mark.slow
def test_a_second_call_goes_on_where_the_first_was_interrupted(case, monkeypatch):
    campaign, record, _ = case
    simulated = []

    def counted(job, *, keep_trace=True):
        simulated.append(job.world.digest())
        return judged(job)

    monkeypatch.setattr(family_runs, "judge", counted)

    def stop(runs):
        if runs == 7:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="kept: 7 finished runs"):
        find_family(campaign, record, max_runs=14, fresh=4, on_run=stop)
    assert len(simulated) == 7
    with (campaign.folder(record) / family.JOURNAL_NAME).open("a") as file:
        file.write('{"run": "torn')
    resumed = find_family(campaign, record, max_runs=14, fresh=4)
    runs = resumed.learning_runs + resumed.precision.trials
    assert len(simulated) == runs <= 14

    (campaign.folder(record) / family.JOURNAL_NAME).unlink()
    assert find_family(campaign, record, max_runs=14, fresh=4) == resumed
    assert simulated[runs:] == simulated[:runs]


def test_a_family_of_a_family_stays_around_the_failure(case, tmp_path):
    campaign, record, program = case
    inside = tmp_path / "inside.scenic"
    number = [d.name for d in program.space.dimensions].index("walker.speed")
    ends = (float(record.candidate.u[number]) - 0.05, float(record.candidate.u[number]) + 0.05)
    inside.write_text(PROGRAM + f"param restrict = {{'walker.speed': {ends}}}\n")
    u = np.array(record.candidate.u)
    u[number] = 0.5
    campaign.settings.trials = dataclasses.replace(campaign.settings.trials, scenario=str(inside))
    moved = dataclasses.replace(record, candidate=dataclasses.replace(record.candidate, u=u))
    found = find_family(campaign, moved, max_runs=14, fresh=4)
    (speed,) = [c for c in found.conditions if c.dimension == "walker.speed"]
    assert speed.low == speed.high == pytest.approx(record.candidate.u[number])
    assert found.precision.estimate == 1.0


def test_dimensions_that_the_runs_did_not_suffice_for_are_held_and_named(case):
    campaign, record, program = case
    found = find_family(campaign, record, max_runs=14, fresh=4)
    assert {c.fate for c in found.conditions} == {"unknown"}
    assert len(found.conditions) + len(found.free) == len(program.space)
    assert "not tried" in found.rule[0]
    assert found.precision.estimate == 1.0


def test_a_trial_that_holds_has_no_family(case):
    campaign, _, _ = case
    holds = TrialRecord(candidate=Candidate(number=0, u=np.zeros(2)), status="ok")
    with pytest.raises(InputError, match="violates nothing"):
        find_family(campaign, holds)


def test_a_program_that_uses_files_beside_it_is_not_moved_away_from_them(case, tmp_path):
    campaign, record, program = case
    program.path.write_text("# localPath('floor.json')\n" + PROGRAM)
    with pytest.raises(InputError, match="its family must lie there too"):
        find_family(campaign, record)
    with pytest.raises(InputError, match="is the program itself"):
        find_family(campaign, record, path=program.path)


def test_peeling_finds_the_edge_between_failing_and_passing_points():
    points = np.random.default_rng(0).random((200, 3))
    center = np.array([0.3, 0.8, 0.5])
    points[0] = center
    failed = (points[:, 0] < 0.5) & (points[:, 1] > 0.6)
    box = peeled_box(points, failed, center)
    assert (box[:, 0] <= center).all()
    assert (box[:, 1] >= center).all()
    assert 0.4 < box[0, 1] <= 0.5
    assert 0.6 <= box[1, 0] < 0.7
    inside = ((points >= box[:, 0]) & (points <= box[:, 1])).all(axis=1)
    assert failed[inside].mean() >= 0.9


def test_peeling_never_cuts_the_failure_itself_away():
    points = np.linspace(0.0, 1.0, 41)[:, None]
    box = peeled_box(points, points[:, 0] == 0.5, np.array([0.5]))
    assert box.tolist() == [[0.5, 0.5]]


@pytest.mark.parametrize(
    ("restriction", "message"),
    [
        ("3", "must read"),
        ("{'nobody.speed': (0, 1)}", "unknown dimension 'nobody.speed'"),
        ("{'walker.speed': (0.6, 0.2)}", "must read"),
        ("{'walker.speed': 0.5}", "must read"),
        ("{'walker.speed': (0, 1.5)}", "must read"),
    ],
)
def test_a_restriction_that_cannot_be_is_refused(restriction, message, tmp_path):
    path = tmp_path / "restricted.scenic"
    path.write_text(PROGRAM + f"param restrict = {restriction}\n")
    with pytest.raises(FormatError, match=message):
        compile_program(path)
