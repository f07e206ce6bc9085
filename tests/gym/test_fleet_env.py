"""Episodes as PettingZoo environments: PettingZoo's own tests, and that nothing differs."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="the extra `gym` is not installed")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # its tests import one of its games by an old name
    from pettingzoo.test import parallel_api_test, parallel_seed_test

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError, InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.feedback import cube_of
from mrta_falsify.core.registry import build
from mrta_falsify.core.seeding import stream
from mrta_falsify.gym import parallel_env
from mrta_falsify.stack.policy import policy_controller
from mrta_falsify.stack.policy.observation import SIZE
from mrta_falsify.stack.policy.policy_file import load_policy
from mrta_falsify.trial import Job, run_job

ROOT = Path(__file__).parents[2]
PURSUIT = str(ROOT / "examples/policy/pursuit.py")
SPECS = ("all_tasks_done", "no_robot_robot_contact", "no_robot_static_contact")
PROGRAM = """
from scenic_worlds.floors import hospital
param layout = hospital(shape='line', rooms=2, spots=1, station=False, parking=2)
model scenic_worlds.model
for i in range(2):
    new Robot with start_room i
new Trolley in corridors
param horizon = 12
param tasks = [(0, 0, 1, Range(4, 60))]
"""


@pytest.fixture
def ward(hall):
    return dataclasses.replace(hall, horizon=8.0)


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("gym") / "two_rooms.scenic"
    path.write_text(PROGRAM)
    return path


def played(env, policy, **options):
    """Play an episode; give all observations and the end."""
    seen, _ = env.reset(**options)
    steps = [seen]
    while env.agents:
        seen, _, _, _, infos = env.step({name: policy(seen[name]) for name in env.agents})
        steps.append(seen)
    return steps, infos[env.possible_agents[0]]["end"]


def test_the_environment_passes_pettingzoos_own_test(ward):
    parallel_api_test(parallel_env(ward, specs=SPECS), num_cycles=100)


def test_the_environment_passes_pettingzoos_seed_test(ward):
    parallel_seed_test(lambda: parallel_env(ward, specs=SPECS), num_cycles=50)


def test_same_seed_and_actions_give_the_same_trace_and_another_seed_does_not(ward):
    ends = []
    for seed in (3, 3, 4):
        random = stream(7, "actions")
        env = parallel_env(ward, specs=SPECS)
        ends.append(played(env, lambda seen, r=random: r.uniform(-1, 1, 2), seed=seed)[1])
    assert ends[0] == ends[1]
    assert ends[0].trace_digest != ends[2].trace_digest


def test_a_policy_sees_and_does_on_trial_what_it_saw_and_did_in_the_environment(ward, monkeypatch):
    env = parallel_env(ward, specs=SPECS)
    steps, end = played(env, load_policy(PURSUIT))
    seen = []
    observe = policy_controller.observe
    monkeypatch.setattr(
        policy_controller, "observe", lambda view: seen.append(observe(view)) or seen[-1]
    )
    choice = Choice(
        "mrta_falsify.stack.policy.policy_controller:PolicyController", {"file": PURSUIT}
    )
    config = dataclasses.replace(env.config, controller=choice)
    outcome = run_job(Job(world=ward, config=config, specifications=SPECS))
    assert outcome.trace.digest == end.trace_digest
    assert outcome.ended == end.ended
    in_env = np.array([[step[name] for name in env.possible_agents] for step in steps])
    assert in_env.shape[1:] == (2, SIZE)
    # The last tick's commands move nobody, so the environment shows the tick once more.
    assert np.array(seen).tobytes() == in_env[: len(seen)].tobytes()


def test_a_sampler_closes_the_loop_and_finds_worlds_that_fail(program):
    env = parallel_env(program, specs=("deadlines", *SPECS))
    sampler = build(
        "sampler", Choice("halton", {"cube": dataclasses.asdict(cube_of(env.space)), "seed": 1})
    )
    ends, policy = [], load_policy(PURSUIT)
    for number in range(4):
        proposal = sampler.ask()
        seed = 1 if number == 0 else None
        _, end = played(env, policy, seed=seed, options={"u": proposal.u})
        sampler.tell(end.feedback(proposal.number, env.played))
        ends.append(end)
    assert len({end.world_digest for end in ends}) == 4
    failed = [end for end in ends if end.failed]
    assert failed
    assert all(end.signature.split("/")[0] in ("deadlines", *SPECS) for end in failed)
    assert all(end.score < 0.0 for end in failed)


def test_the_same_point_and_seed_give_the_same_world(program):
    env = parallel_env(program, specs=SPECS)
    u = np.full(len(env.space), 0.3)
    worlds = [env.reset(seed=5, options={"u": u})[1] for _ in range(2)]
    assert worlds[0] == worlds[1]
    assert env.reset(options={"u": u})[1] != worlds[0]  # its noise is another
    (info,) = {str(i) for i in env.reset(options={"world": env.played.world})[1].values()}
    assert env.played.world.digest() in info


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"u": [0.5]}, "must be"),
        ({"u": "all"}, "must be"),
        ({"u": [0.5], "world": "x.json"}, "give one of them"),
        ({"world": "nowhere.json"}, "nowhere.json"),
    ],
)
def test_options_that_cannot_be_used_are_refused(program, options, message):
    with pytest.raises(InputError, match=message):
        parallel_env(program, specs=SPECS).reset(options=options)


def test_worlds_with_other_robots_are_refused(ward):
    other = dataclasses.replace(ward, robots=ward.robots[:1])
    with pytest.raises(InputError, match="was made for robot1, robot2"):
        parallel_env(ward, specs=SPECS).reset(options={"world": other})


def test_a_fixed_world_has_no_point_and_a_foreign_stack_no_controller(ward):
    with pytest.raises(ConfigError, match="no random choices"):
        parallel_env(ward).reset(options={"u": []})
    foreign = StackConfig(stack=ExternalStack(command=("true",)))
    with pytest.raises(ConfigError, match="process of its own"):
        parallel_env(ward, foreign)


def test_steps_without_an_episode_and_actions_that_are_none_are_refused(ward):
    env = parallel_env(ward, specs=SPECS)
    with pytest.raises(ConfigError, match="call reset"):
        env.step({})
    env.reset()
    with pytest.raises(ConfigError, match="2 finite numbers"):
        env.step({"robot1": [np.nan, 0.0]})


def test_progress_pays_contact_costs_and_a_violation_ends_an_episode(ward):
    world = dataclasses.replace(ward, horizon=30.0)  # straight on, the walls are 10 m away
    env = parallel_env(world, specs=SPECS, early_stop=True)
    env.reset()
    rewards = []
    while env.agents:
        _, reward, terminated, truncated, infos = env.step(dict.fromkeys(env.agents, (1.0, 0.0)))
        rewards.append(reward["robot1"])
    assert infos["robot1"]["end"].ended == "decided"
    assert infos["robot1"]["end"].failed
    assert terminated["robot1"]
    assert not truncated["robot1"]
    assert min(rewards) < -0.9
    assert max(rewards) > 0.01


def test_the_extra_is_loaded_only_when_an_environment_is_made():
    code = (
        "import sys, mrta_falsify.gym; "
        "assert not {'pettingzoo', 'gymnasium'} & set(sys.modules), 'loaded'"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
