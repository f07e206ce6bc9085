"""A run that goes on before it knows an answer, and is taken back where that was wrong."""

import os
import signal
import time
from pathlib import Path

import pytest

from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Task
from mrta_falsify.process import snapshot
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import Request, Supervisor, run_supervised
from mrta_falsify.process.watch import current_watch
from simulator_interface import forecast, speculation
from simulator_interface.guard import Guard
from simulator_interface.simulate import simulate
from tests.simulator_interface.test_forecast import DRIVE, rooms, stack

LIMITS = StackLimits(tick=5.0, memory=2.0)


class Arrival:
    """Does the robot pass a place by a time? It is expected to."""

    series = None

    def __init__(self, place: float, until: float) -> None:
        self.place, self.until = self.question = place, until
        self.expected: dict | None = {"passes": True}
        self.passed = False
        self.frames = 0

    def resume(self, question) -> bool:
        raise AssertionError("there is one question")

    def update(self, frame) -> bool:
        self.frames += 1
        self.passed = self.passed or bool(frame.sensed.pose[0, 0] > self.place)
        return self.passed or frame.sensed.time >= self.until

    def is_as_expected(self) -> bool:
        return self.passed

    def answer(self) -> dict:
        return {"passes": True} if self.passed else {"passes": False, "frames": self.frames}


class Asking:
    """Asks at given times for arrivals, and says what it was told in which process."""

    waits_later = False  #: for the answers to all questions but the first

    def __init__(self, *questions: tuple[float, float, float]) -> None:
        self.questions = questions

    def start(self, world, dt) -> None:
        self.answers: list = []

    def foresee(self, forecast) -> None:
        self.forecast = forecast

    def update(self, frame) -> None:
        for at, place, until in self.questions:
            if abs(frame.sensed.time - at) < 1e-9:
                watch = Arrival(place, until)
                if self.waits_later and self.answers:
                    watch.expected = None
                answer = self.forecast(watch)
                self.answers.append((at, answer["passes"], answer.get("frames")))

    def verdict(self) -> Verdict:
        evidence = {"answers": self.answers, "process": os.getpid()}
        return Verdict(spec="asking", robustness=1.0, violated=False, evidence=evidence)


@pytest.fixture
def guard():
    guard = Guard()
    yield guard
    guard.close()


@pytest.fixture
def checkpoints(monkeypatch, tmp_path) -> Path:
    """A file with the letter of each checkpoint that is made or woken, in any process."""
    file = tmp_path / "checkpoints"
    file.touch()

    def noted():
        point = snapshot.snapshot()
        with file.open("a") as out:
            out.write("m" if isinstance(point, snapshot.Snapshot) else "w")
        return point

    monkeypatch.setattr(speculation, "snapshot", noted)
    return file


class WaitingLater(Asking):
    waits_later = True


def both(guard, world, *questions, limits=LIMITS, asking=Asking):
    """Outcomes of a run that waits for each answer, and of one that does not."""
    config = stack()
    waiting = simulate(world, config, specifications=[asking(*questions)])
    ahead = guard.run(
        lambda: simulate(world, config, specifications=[asking(*questions)]),
        config=config,
        limits=limits,
        portable=False,
    )
    assert ahead.trace.digest == waiting.trace.digest
    assert ahead.ended == waiting.ended
    told, known = (outcome.verdicts[0].evidence["answers"] for outcome in (ahead, waiting))
    assert told == known
    return ahead, told


@pytest.fixture
def own_checkpoints(monkeypatch):
    """Each question has a checkpoint of its own."""
    monkeypatch.setattr(speculation, "REUSED_FOR", 0.0)


def test_an_answer_as_expected_costs_no_second_run(guard, checkpoints):
    _, told = both(guard, rooms(), (1.0, 0.0, 30.0), (1.5, 0.5, 30.0))
    assert told == [(1.0, True, None), (1.5, True, None)]
    assert checkpoints.read_text() == "m"  # one checkpoint for both


def test_a_run_is_taken_back_where_the_answer_is_another(guard, checkpoints):
    _, told = both(guard, rooms(), (1.0, 9.0, 3.0), (2.0, 0.0, 30.0))
    assert told == [(1.0, False, 20), (2.0, True, None)]
    assert checkpoints.read_text() == "mw"  # the second question went to a copy


def test_a_run_that_was_taken_back_goes_on_ahead_once_it_has_come_as_far_as_before(
    guard, checkpoints
):
    _, told = both(guard, rooms(), (1.0, 9.0, 3.0), (2.0, 0.0, 30.0), (3.2, 0.5, 30.0))
    assert told == [(1.0, False, 20), (2.0, True, None), (3.2, True, None)]
    assert checkpoints.read_text() == "mwm"


def test_a_run_may_be_taken_back_farther_than_to_the_question(guard, checkpoints):
    _, told = both(guard, rooms(), (1.0, 0.0, 30.0), (1.5, 9.0, 2.0))
    assert told == [(1.0, True, None), (1.5, False, 5)]
    assert checkpoints.read_text() == "mw"  # the first question went to a copy then
    checkpoints.write_text("")
    _, told = both(guard, rooms(), (1.0, 9.0, 4.0), (1.5, 9.0, 2.0))
    assert told == [(1.0, False, 30), (1.5, False, 5)]
    assert checkpoints.read_text() == "mw"


def test_a_checkpoint_serves_later_questions_once_the_first_is_answered(guard, checkpoints):
    at_once = (-100.0, 30.0)
    _, told = both(guard, rooms(), (1.0, *at_once), (1.5, *at_once))
    assert told == [(1.0, True, None), (1.5, True, None)]
    assert checkpoints.read_text() == "m"


@pytest.fixture
def copies(checkpoints, monkeypatch) -> Path:
    """The file of checkpoints, with a letter for each copy that answers one question as well."""

    def noted(call):
        with checkpoints.open("a") as out:
            out.write("c")
        return run_supervised(call)

    monkeypatch.setattr(forecast, "run_supervised", noted)
    return checkpoints


def test_a_run_that_was_taken_back_knows_what_was_answered_as_expected(guard, copies):
    _, told = both(guard, rooms(), (1.0, -100.0, 30.0), (1.5, 9.0, 2.0))
    assert told == [(1.0, True, None), (1.5, False, 5)]
    assert copies.read_text() == "ccmw"  # the copies are those of the run that waits


def test_a_run_that_is_to_be_taken_back_waits_for_no_answer_before(guard, copies):
    questions = (1.0, 9.0, 3.0), (1.5, 0.0, 30.0)
    _, told = both(guard, rooms(), *questions, asking=WaitingLater)
    assert [passes for _, passes, _ in told] == [False, True]
    assert copies.read_text() == "ccmwc"


def test_an_earlier_question_that_is_open_is_answered_before_a_run_is_taken_back(
    guard, checkpoints, own_checkpoints
):
    _, told = both(guard, rooms(), (1.0, 0.0, 30.0), (1.5, 9.0, 2.0))
    assert told == [(1.0, True, None), (1.5, False, 5)]
    assert checkpoints.read_text() == "mmw"
    checkpoints.write_text("")
    _, told = both(guard, rooms(), (1.0, 9.0, 4.0), (1.5, 9.0, 2.0))
    assert told == [(1.0, False, 30), (1.5, False, 5)]
    assert checkpoints.read_text() == "mmw"


def test_what_comes_from_outside_does_not_answer(guard, checkpoints):
    late = Task(arrival=3.0, start=1, end=0, deadline=900.0)
    _, told = both(guard, rooms(tasks=(late,)), (1.0, 0.0, 20.0))
    assert told == [(1.0, False, 190)]  # without the task the robot has nowhere to go
    _, told = both(guard, rooms(tasks=(late,)), (2.9, 0.0, 20.0))  # the frame before
    assert told == [(2.9, False, 171)]
    _, told = both(guard, rooms(tasks=(late,)), (3.0, 0.0, 20.0))
    assert told == [(3.0, True, None)]


def test_a_question_that_is_open_at_the_end_is_answered(guard, checkpoints):
    outcome, told = both(guard, rooms(horizon=4.0), (1.0, 9.0, 8.0))
    assert outcome.ended == "horizon"
    assert told == [(1.0, False, 70)]
    assert checkpoints.read_text() == "mw"


def test_no_more_checkpoints_are_made_than_allowed(
    guard, checkpoints, own_checkpoints, monkeypatch
):
    monkeypatch.setattr(speculation, "MAX_POINTS", 2)
    both(guard, rooms(), *[(1.0 + 0.1 * k, 0.0, 30.0) for k in range(4)])
    assert checkpoints.read_text() == "mm"
    checkpoints.write_text("")
    both(guard, rooms(), *[(1.0 + 0.1 * k, 0.0, 30.0) for k in range(3)], (1.3, 9.0, 2.0))
    assert checkpoints.read_text() == "mmw"  # to the second, which serves the fourth, too


def test_the_process_that_waits_takes_the_next_request(guard):
    first, _ = both(guard, rooms(), (1.0, 9.0, 3.0))
    second, _ = both(guard, rooms(), (1.0, 0.0, 30.0))
    processes = [one.verdicts[0].evidence["process"] for one in (first, second)]
    assert processes[0] != processes[1]
    with pytest.raises(ProcessLookupError):
        os.kill(processes[0], 0)
    os.kill(processes[1], 0)


# --- what becomes of the processes -----------------------------------------------------------


def taken_back(then):
    """A request whose run is taken back once; ``then`` is called in the copy."""

    def call():
        point = snapshot.snapshot()
        if isinstance(point, snapshot.Snapshot):
            raise point.rollback("answer")
        assert point.answer == "answer"
        return then()

    return Request(call, None, True)


def answer_of(request, limits=LIMITS):
    copy = Supervisor(Budget.of_stack(limits))
    try:
        copy.ask(request)
        return copy.answer()
    finally:
        copy.close()


def in_stack(call):
    current_watch().enter(7, 0.35)
    call()


def test_a_copy_that_took_over_answers_and_fails_like_any_other():
    assert answer_of(taken_back(lambda: "done")) == "done"
    with pytest.raises(ZeroDivisionError):
        answer_of(taken_back(lambda: 1 / 0))
    for ending, words in (
        (lambda: os._exit(3), "exit code 3"),
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), "SIGSEGV"),
    ):
        with pytest.raises(Ending) as failed:
            answer_of(taken_back(lambda ending=ending: in_stack(ending)))
        assert (failed.value.kind, failed.value.tick) == ("crash", 7)
        assert words in str(failed.value)


def test_a_hang_in_a_copy_that_took_over_is_found_where_it_is():
    def spin():
        while True:
            pass

    with pytest.raises(Ending) as failed:
        answer_of(taken_back(lambda: in_stack(spin)), StackLimits(tick=0.2, memory=1.0))
    assert failed.value.kind == "hang"
    assert "spin\n" in failed.value.where


def test_sleeping_copies_end_with_the_run():
    def call():
        snapshot.snapshot()
        children = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
        return [int(child) for child in children.split()]

    copy = Supervisor(Budget.of_stack(LIMITS))
    copy.ask(Request(call, None, True))
    (sleeping,) = copy.answer()
    os.kill(sleeping, 0)
    copy.close()
    for _ in range(100):
        if not is_running(sleeping):
            break
        time.sleep(0.02)
    assert not is_running(sleeping)


def is_running(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def test_runs_that_nobody_watches_wait_for_their_answers(checkpoints):
    simulate(rooms(tasks=(DRIVE,)), stack(), specifications=[Asking((1.0, 0.0, 30.0))])
    assert checkpoints.read_text() == ""
