"""User formulas: syntax, signals, and the engine against our own evaluator."""

import dataclasses

import numpy as np
import pytest
import sentil
import stl_reference
from frames import Human, Robot, Script, drive, judge
from hypothesis import given, settings
from hypothesis import strategies as st
from stl_reference import Junction, Not, Predicate, Temporal, Until

from mrta_falsify.core.errors import ConfigError, UnknownNameError
from mrta_falsify.specs import signals
from mrta_falsify.specs.stl import StlSpecification


def formula(text: str) -> StlSpecification:
    return StlSpecification(StlSpecification.Options(formula=text))


PASS = Script(
    robots=[Robot(drive((-3, 0), (3, 0), 0.8), goal=(3, 0)), Robot((0, 3))],
    humans=[Human((0, 0.9))],
    seconds=8.0,
)


def test_always_over_a_gap_gives_its_minimum():
    verdict = judge(formula("always (d_human > 0.5)"), PASS)
    assert verdict.robustness == pytest.approx(0.9 - 0.47 - 0.5, abs=0.01)
    assert verdict.spec == "stl:always (d_human > 0.5)"
    assert verdict.violated_at == pytest.approx(3.4, abs=0.4)
    assert verdict.evidence["signals"]["d_human"] < 0.5


def test_robot_signals_are_written_as_calls():
    verdict = judge(formula("always (speed(robot1) < 0.5)"), PASS)
    assert verdict.robustness == pytest.approx(-0.3)
    assert verdict.who == ("robot1",)
    assert not judge(formula("eventually (goal_distance(robot1) < 0.1)"), PASS).violated


def test_windows_are_in_seconds():
    assert not judge(formula("always[0, 2] (d_human > 0.5)"), PASS).violated
    assert judge(formula("always[3, 4.5] (d_human > 0.5)"), PASS).violated


def test_a_bounded_obligation_is_violated_when_its_time_is_up():
    verdict = judge(formula("eventually[0, 2] (goal_distance(robot1) < 0.1)"), PASS)
    assert verdict.violated_at == pytest.approx(2.0)


def test_signals_of_the_frame_can_be_used():
    script = Script(robots=[Robot((0, 0))], seconds=2.0, signals=lambda t: {"battery": 1.0 - t})
    verdict = judge(formula("always (battery > 0)"), script)
    assert verdict.robustness == pytest.approx(-1.0)


@pytest.mark.parametrize("name", [*signals.FLEET, *(f"{name}(robot2)" for name in signals.ROBOT)])
def test_every_documented_signal_can_be_read(name):
    short = Script(robots=PASS.robots, humans=PASS.humans, seconds=0.2)
    assert np.isfinite(judge(formula(f"eventually ({name} >= 0)"), short).robustness)
    assert f"``{name.replace('robot2', 'r')}``" in signals.__doc__


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("always (d_human >", "column 18"),
        ("", "column 1"),
        ("always (speed(robot1) > 0.5", "column 28"),
        ("G[0:1] (d_human > 0)", "column 4"),
        ("always[2, 1] (d_human > 0)", "lower bound 2"),
        ("P>=0.9 (d_human > 0)", "operator P"),
    ],
)
def test_a_syntax_error_says_where(text, message):
    with pytest.raises(ConfigError, match="stl formula") as error:
        formula(text)
    assert message in str(error.value)


def test_an_unknown_function_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'speed'"):
        formula("always (sped(robot1) > 0)")


def test_an_unknown_robot_is_refused_at_the_start():
    with pytest.raises(UnknownNameError, match="Known: robot1, robot2"):
        judge(formula("always (speed(robot9) > 0)"), PASS)


def test_an_unknown_signal_is_refused_at_the_first_tick():
    with pytest.raises(UnknownNameError, match="did you mean 'd_human'"):
        judge(formula("always (d_humen > 0)"), PASS)


def test_robustness_of_an_empty_window_is_finite():
    verdict = judge(formula("always[50, 60] (d_human > 0.5)"), PASS)
    assert verdict.robustness == 1e6


predicates = st.builds(
    Predicate,
    st.sampled_from("xy"),
    st.sampled_from(["<", "<=", ">", ">="]),
    st.integers(-20, 20).map(lambda n: n / 8),
)
windows = st.one_of(
    st.just((0, None)),
    st.tuples(st.integers(0, 4), st.integers(0, 8)).map(lambda w: (w[0], sum(w))),
)


def larger(inner):
    return st.one_of(
        st.builds(Not, inner),
        st.builds(Junction, st.sampled_from(["and", "or", "->"]), inner, inner),
        st.builds(
            lambda operator, window, node: Temporal(operator, *window, node),
            st.sampled_from(["always", "eventually", "historically", "once"]),
            windows,
            inner,
        ),
        st.builds(lambda window, a, b: Until(*window, a, b), windows, inner, inner),
    )


@settings(max_examples=300, deadline=None)
@given(
    node=st.recursive(predicates, larger, max_leaves=6),
    rows=st.lists(st.tuples(st.integers(-24, 24), st.integers(-24, 24)), min_size=1, max_size=25),
)
def test_engine_agrees_with_our_evaluator(node, rows):
    table = np.array(rows, dtype=np.float64) / 8
    columns = {"x": table[:, 0].copy(), "y": table[:, 1].copy()}
    trace = sentil.Trace(np.arange(len(table), dtype=np.float64), columns)
    engine = sentil.Formula.parse(stl_reference.to_text(node)).robustness_signal(trace)
    np.testing.assert_array_equal(engine, stl_reference.robustness(node, columns))


def test_what_may_still_come_true_is_violated_at_no_time_until_the_horizon():
    begun = judge(formula("eventually (d_human > 9.0)"), PASS)
    assert begun.violated
    assert begun.violated_at is None  # or a search would end the episode here
    never = judge(formula("eventually (d_human > 9.0)"), dataclasses.replace(PASS, horizon=8.0))
    assert never.violated_at == pytest.approx(8.0, abs=0.1)


def test_a_verdict_on_the_way_does_not_disturb_the_last_one():
    asked = formula("always[3, 4.5] (d_human > 0.5)")
    plain = judge(formula("always[3, 4.5] (d_human > 0.5)"), PASS)
    assert judge(_asking_all_the_time(asked), PASS) == plain


class _asking_all_the_time:
    def __init__(self, inner):
        self.inner = inner
        self.start = inner.start
        self.verdict = inner.verdict

    def update(self, frame):
        self.inner.update(frame)
        self.inner.verdict()
