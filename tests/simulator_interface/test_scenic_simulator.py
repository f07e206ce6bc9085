"""Scenic's simulator interface: one loop for both, dynamic statements, errors in words."""

import dataclasses
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import Blockage, read_world
from simulator_interface.simulate import simulate

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
SCENIC = Path(sys.executable).parent / "scenic"

HEAD = """
param horizon = {horizon}
model scenic_worlds.model
param engine = 'kinematic'
param specs = ('no_robot_robot_contact',)
new Robot with start_room 1, with name 'robot1'
"""


@pytest.fixture
def realise(tmp_path):
    """Compile a program and draw its scene and world."""

    def realise(body, *, horizon=8.0, seed=0, head=HEAD):
        from scenic_worlds.program import compile_program

        path = tmp_path / "program.scenic"
        path.write_text(head.replace("{horizon}", str(horizon)) + body)
        program = compile_program(path, needs_tasks=False)
        return program.realise(program.candidate(seed))

    return realise


def simulated(realised, **options):
    from simulator_interface.scenic_bridge.simulator import PyBulletSimulator

    simulator = PyBulletSimulator(realise=lambda _: realised.world, specifications=tuple)
    return simulator.simulate(realised.scene, verbosity=0, **options)


def y_of(simulation, name):
    return np.array([value for _, value in simulation.result.records[name]])


# --- one loop ------------------------------------------------------------------------------


def test_scenic_and_run_give_one_trace_for_one_candidate(realise):
    drawn = realise(
        """
        new Human with route [(4.4, -10), (4.4, -2)], with speed Range(0.6, 1.3)
        new Trolley in corridors, facing Range(0, 360) deg
        param tasks = [(0, 1, DiscreteRange(2, 4), 300)]
        """.replace("\n        ", "\n"),
        seed=4,
    )
    through_scenic = simulated(drawn)
    assert through_scenic.outcome.ended == "horizon"
    assert through_scenic.outcome.trace.digest == simulate(drawn.world, KINEMATIC).trace.digest


def test_objects_follow_the_frames_of_the_run(realise):
    drawn = realise(
        "joe = new Human with route [(4.4, -10), (4.4, -2)], with name 'joe'\n"
        "record (joe.position.x, joe.position.y, joe.yaw, joe.speed) as joe\n",
        horizon=4.0,
    )
    simulation = simulated(drawn)
    trace = simulation.outcome.trace
    for step, (x, y, yaw, speed) in simulation.result.records["joe"][1:]:
        place = trace.columns["human_position"][5 * step, 0]
        pace = trace.columns["human_velocity"][5 * step, 0]
        assert (x, y) == pytest.approx(tuple(place))
        assert speed == pytest.approx(float(np.hypot(*pace)))
        if speed > 0.1:  # Scenic's yaw 0 points north
            forward = np.array([-np.sin(yaw), np.cos(yaw)])
            assert forward @ (pace / speed) == pytest.approx(1.0)
    assert len(simulation.trajectory) == 17
    assert simulation.trajectory[-1][1].y == pytest.approx(
        trace.columns["human_position"][-1, 0, 1]
    )


@pytest.mark.slow
def test_scenic_on_the_command_line_writes_a_run_that_replays_without_it(tmp_path):
    program = tmp_path / "short.scenic"
    program.write_text(
        HEAD.replace("{horizon}", "6.0")
        + "new Human at (4.4, -10), with name 'joe',\n"
        + "    with behavior InTurn(WalkTo((4.4, -6)), Leave())\n"
    )
    command = [SCENIC, "-S", program, "--count", "1", "-p", "output", tmp_path / "runs"]
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    printed = re.search(r"6\.0 s simulated, ended: horizon; .* trace (\w+)", done.stdout)
    world = read_world(tmp_path / "runs" / "1" / "world.json")
    trace = read_trace(tmp_path / "runs" / "1" / "trace.zip")
    assert trace.digest.startswith(printed[1])
    assert trace.digest == simulate(world, KINEMATIC).trace.digest
    assert world.name == "short"


@pytest.mark.slow
def test_sampling_a_program_loads_neither_engine_nor_stack(tmp_path):
    program = tmp_path / "plain.scenic"
    program.write_text(HEAD.replace("{horizon}", "6.0") + "new Human with route [(4.4, -10)]\n")
    code = (
        "import sys; from scenic_worlds.program import compile_program as c; from pathlib import "
        f"Path; p = c(Path({str(program)!r}), needs_tasks=False); p.sample(0);"
        "print({'pybullet', 'mrta_falsify.stack.pipeline'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == "set()"


# --- behaviours ------------------------------------------------------------------------------


def test_a_library_behavior_becomes_directives_and_replays(realise):
    drawn = realise(
        "cart = new Trolley at (4.4, -6), facing 0 deg, with name 'cart'\n"
        "new Human at (4.4, -9), with behavior InTurn(\n"
        "    WaitFor(Range(0.5, 1.0)), Push(cart, (4.4, -4)), WalkTo('ward_northeast'), Leave())\n",
        horizon=10.0,
    )
    kinds = [directive.kind for directive in drawn.world.humans[0].directives]
    assert kinds == ["wait", "push", "walk_to", "leave"]
    assert drawn.world.movable_furniture()[0].name == "cart"
    assert drawn.world.scripted == ""
    simulation = simulated(drawn)
    assert simulation.outcome.trace.digest == simulate(drawn.world, KINEMATIC).trace.digest
    assert simulation.world.digest() == drawn.world.digest()
    assert simulation.outcome.trace.columns["furniture_pose"][-1, 0, 1] > -4.2


OWN = """
behavior Rounds():
    try:
        do FollowRoute([(4.4, -6), (4.4, -10)], repeat=True)
    interrupt when 2 <= now() < 4:
        do StandStill() until now() >= 4

behavior There():
    do WalkTo((5.4, -4)) for 2 seconds
    do WaitFor(1)
    wait
    do WalkTo((5.4, -10))

def now():
    return simulation().currentRealTime

joe = new Human at (4.4, -10), with behavior Rounds()
ann = new Human at (5.4, -10), with behavior There()
record joe.position.y as joe
record ann.position.y as ann
"""


@pytest.fixture(scope="module")
def own_behaviors(tmp_path_factory):
    from scenic_worlds.program import compile_program

    path = tmp_path_factory.mktemp("own") / "own.scenic"
    path.write_text(HEAD.replace("{horizon}", "9.0") + OWN)
    program = compile_program(path, needs_tasks=False)
    drawn = program.realise(program.candidate(0))
    return drawn, simulated(drawn)


def test_interrupts_stop_an_errand_and_let_it_go_on(own_behaviors):
    _, simulation = own_behaviors
    y = y_of(simulation, "joe")
    assert y[8] > -9.0  # walked for two seconds
    assert np.ptp(y[10:16]) < 0.2  # stood for two
    assert y[24] > y[16] + 1.0  # and went on


def test_do_for_ends_an_errand_and_who_has_none_stands(own_behaviors):
    _, simulation = own_behaviors
    y = y_of(simulation, "ann")
    assert y[8] > -9.0
    assert np.ptp(y[10:12]) < 0.1
    assert y[-1] < y[8] - 0.8  # on the way back


def test_a_world_of_own_behaviors_says_that_it_needs_its_program(own_behaviors):
    drawn, simulation = own_behaviors
    assert drawn.world.scripted == "behaviors of its own (human_1, human_2)"
    with pytest.raises(WorldError, match="cannot be run without its Scenic program"):
        simulate(drawn.world, KINEMATIC)
    assert simulation.world.scripted == drawn.world.scripted


def test_own_behaviors_give_the_same_trace_again(own_behaviors):
    from simulator_interface.scenic_bridge.simulator import simulate_scene

    drawn, simulation = own_behaviors

    def interrupt(frame):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # and Scenic begins the next run from scratch
        simulate_scene(drawn.scene, drawn.world, KINEMATIC, stop=interrupt)
    again = simulate_scene(drawn.scene, drawn.world, KINEMATIC)
    assert again.trace.digest == simulation.outcome.trace.digest


def test_what_behaviors_draw_comes_from_the_seed_of_the_world(realise):
    drawn = realise(
        "behavior Any():\n"
        "    do WaitFor(Range(0, 3))\n"
        "    do WalkTo((4.4, -6))\n"
        "new Human at (4.4, -10), with behavior Any()\n",
        horizon=5.0,
    )
    digests = []
    for seed in (1, 1, 2):
        world = dataclasses.replace(drawn.world, seed=seed)
        digests.append(simulated(dataclasses.replace(drawn, world=world)).outcome.trace.digest)
    assert digests[0] == digests[1] != digests[2]


def test_behaviors_run_outside_the_main_thread(own_behaviors):
    from simulator_interface.scenic_bridge.simulator import simulate_scene

    drawn, simulation = own_behaviors
    found = []
    worker = threading.Thread(
        target=lambda: found.append(simulate_scene(drawn.scene, drawn.world, KINEMATIC))
    )
    worker.start()
    worker.join()
    assert found[0].trace.digest == simulation.outcome.trace.digest


def test_a_robot_with_a_behavior_does_not_belong_to_the_fleet(realise):
    drawn = realise(
        "new Robot at (4.4, -10), with name 'cleaner',\n"
        "    with behavior WalkTo((4.4, -7), speed=0.5)\n",
    )
    assert [robot.name for robot in drawn.world.robots] == ["robot1"]
    cleaner = drawn.world.humans[0]
    assert (cleaner.name, cleaner.body) == ("cleaner", "robot")
    trace = simulated(drawn).outcome.trace
    assert trace.columns["human_position"][-1, 0, 1] == pytest.approx(-7.0, abs=0.5)


# --- stops, records, appearing -----------------------------------------------------------------


WALKS = (
    "joe = new Human at (4.4, -10), with behavior WalkTo((4.4, -4))\nrecord joe.position.y as y\n"
)


def test_a_violated_requirement_ends_the_run_with_what_was_logged(realise):
    drawn = realise(
        WALKS + "require always joe.position.y < -8\nrecord final joe.position.y as last\n"
    )
    simulation = simulated(drawn)
    outcome = simulation.outcome
    assert outcome.ended.startswith("rejected: ")
    assert simulation.rejected
    assert "violated" in simulation.result.terminationReason
    y = y_of(simulation, "y")
    assert y[-2] < -8 <= y[-1]
    assert simulation.result.records["last"] == y[-1]
    assert 0.0 < outcome.sim_time < 8.0
    whole = simulate(drawn.world, KINEMATIC).trace
    ticks = len(outcome.trace)
    assert np.array_equal(outcome.trace.columns["pose"], whole.columns["pose"][:ticks])


@pytest.mark.parametrize(
    "stop",
    [
        "terminate when joe.position.y > -8\n",
        "terminate simulation when joe.position.y > -8\n",
        "terminate after 2.5 seconds\n",
        "monitor Far():\n    while joe.position.y <= -8:\n        wait\n    terminate\n"
        "require monitor Far()\n",
    ],
    ids=["when", "simulation", "after", "monitor"],
)
def test_scenics_own_ends_end_the_run(realise, stop):
    simulation = simulated(realise(WALKS + stop))
    assert simulation.outcome.ended.startswith("scenic: ")
    assert 1.5 <= simulation.outcome.sim_time <= 4.0
    assert simulation.rejected == ""


COMPOSED = """
param horizon = 8.0
model scenic_worlds.model
param engine = 'kinematic'
scenario Calm():
    compose:
        while True:
            wait
scenario Drop(visitor):
    setup:
        new Bed at (4.4, -2), with name 'lost_bed'
        new Human at (5, -10), with name visitor, with behavior WalkTo((5, -6))
        new Human at (5, -14), with route [(5, -14), (5, -18)]
    compose:
        wait
scenario Main():
    setup:
        new Robot with start_room 1
        new Human with route [(4, 11.1), (4, 2)], with name 'joe'
    compose:
        do Calm() for 2 seconds
        do Drop('kate')
        do Calm()
"""


def test_what_appears_in_a_compose_block_is_in_the_world_and_replays(realise):
    drawn = realise(COMPOSED, head="")
    assert drawn.world.scripted == "its compose block"
    simulation = simulated(drawn)
    world, trace = simulation.world, simulation.outcome.trace
    (bed,) = [event for event in world.events if isinstance(event, Blockage)]
    assert bed.name == "lost_bed"
    assert bed.start == pytest.approx(2.05)
    people = trace.columns["human_position"]
    assert np.isnan(people[40, 1]).all()
    assert people[42, 1] == pytest.approx([5.0, -10.0], abs=0.1)
    assert people[-1, 1, 1] > -7.0
    assert people[-1, 2, 1] < -15.0
    assert np.isnan(people[:, 3:]).all()  # places that nobody took
    assert world.scripted == ""
    assert simulate(world, KINEMATIC).trace.digest == trace.digest


def test_more_late_people_than_places_is_an_error_with_the_way_out(realise):
    from scenic.core.simulators import SimulationCreationError

    drawn = realise(COMPOSED.replace("model", "param late_people = 1\nmodel", 1), head="")
    with pytest.raises(SimulationCreationError, match="param late_people = N"):
        simulated(drawn)


def test_a_robot_cannot_appear_mid_run(realise):
    from scenic.core.simulators import SimulationCreationError

    text = COMPOSED.replace("new Bed at (4.4, -2), with name 'lost_bed'", "new Robot at (4.4, -2)")
    with pytest.raises(SimulationCreationError, match=r"a robot cannot appear .* joins_at"):
        simulated(realise(text, head=""))


# --- errors in words -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "args", "words"),
    [
        ("WalkTo", ("nowhere",), "unknown room 'nowhere'"),
        ("WalkTo", (None,), "place is None; it must be a room, a point"),
        ("WalkTo", ((1, "b"),), "place is 'b'; it must be a finite number"),
        ("WaitFor", (-1,), "seconds is -1"),
        ("FollowRoute", ([],), "route is empty"),
        ("FollowRoute", (3,), "route is 3; it must be a list of places"),
        ("InTurn", (3,), "step 1 is 3; it must be a behavior of"),
        ("Push", (7, (4, -6)), "thing is 7; it must be furniture"),
    ],
)
def test_a_wrong_argument_of_a_behavior_is_named_with_what_is_allowed(name, args, words):
    from scenic_worlds.places import places_of
    from simulator_interface.scenic_bridge.behaviors import BehaviorReader

    reader = BehaviorReader(places_of("aws_hospital"), {})
    with pytest.raises(InputError, match=f"behavior {name}: .*{re.escape(words)}"):
        reader.read(name, args, {})


def test_a_wrong_argument_of_a_behavior_names_the_person(realise):
    with pytest.raises(InputError, match="joe: behavior WalkTo: unknown room 'nowhere'"):
        realise("new Human at (4, -9), with name 'joe', with behavior WalkTo('nowhere')\n")


def test_pushing_what_has_no_wheels_is_refused_with_file_and_line(realise):
    from simulator_interface.scenic_bridge.simulator import simulate_scene

    drawn = realise(
        "shelf = new Bookshelf at (4.4, -6), facing 0 deg, with name 'shelf'\n"
        "behavior Try():\n"
        "    do Push(shelf, (4.4, -4))\n"
        "new Human at (4.4, -10), with behavior Try()\n"
    )
    with pytest.raises(WorldError, match=r"program\.scenic:\d+: .*'shelf'.*movable true"):
        simulate_scene(drawn.scene, drawn.world, KINEMATIC)


def test_an_error_in_the_program_while_it_runs_names_file_and_line(realise):
    from simulator_interface.scenic_bridge.simulator import simulate_scene

    drawn = realise(
        "behavior Broken():\n"
        "    do WaitFor(1)\n"
        "    do WalkTo((1 / 0, 2))\n"
        "new Human at (4.4, -10), with behavior Broken()\n"
    )
    with pytest.raises(WorldError, match=r"program\.scenic:9: ZeroDivisionError"):
        simulate_scene(drawn.scene, drawn.world, KINEMATIC)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"engine": "unreal"}, "param engine: unknown engine 'unreal'"),
        ({"settings": "planner"}, "must read layer=NAME"),
        ({"settings": 3}, "param settings is 3"),
        ({"seed": -1}, "param seed is -1"),
        ({"stack": "missing.yaml"}, "missing.yaml: cannot be read"),
    ],
)
def test_wrong_parameters_are_refused_in_words(params, words):
    from simulator_interface.scenic_bridge.parameters import read_parameters

    with pytest.raises(InputError, match=re.escape(words)):
        read_parameters(params)


def test_parameters_choose_stack_and_specifications(tmp_path):
    from simulator_interface.scenic_bridge.parameters import read_parameters

    stack = tmp_path / "stack.yaml"
    stack.write_text("engine: bullet\nplanner: {name: astar}\ncontrol_rate: 10\n")
    settings = read_parameters(
        {
            "stack": str(stack),
            "settings": "costmap.inflation_radius=0.4, queue_policy=deadline_first",
            "engine": "kinematic",
            "specs": ["progress"],
            "seed": 7.0,
        }
    )
    config = settings.config
    assert (config.engine.name, config.control_rate) == ("kinematic", 10)
    assert config.costmap.options == {"inflation_radius": 0.4}
    assert config.queue_policy.name == "deadline_first"
    assert (settings.specifications, settings.seed) == (("progress",), 7)


def test_a_time_step_that_is_no_multiple_of_the_control_period_is_refused(realise):
    from scenic.core.simulators import SimulationCreationError

    with pytest.raises(SimulationCreationError, match=r"0\.12 s; it must be a multiple .* 0\.05 s"):
        simulated(realise("", horizon=1.0), timestep=0.12)


def test_a_finer_time_step_changes_nothing_in_the_world(realise):
    drawn = realise("new Human with route [(4.4, -10), (4.4, -2)]\n", horizon=2.0)
    coarse, fine = simulated(drawn), simulated(drawn, timestep=0.05)
    assert fine.currentTime == 5 * coarse.currentTime == 40
    assert fine.outcome.trace.digest == coarse.outcome.trace.digest


def test_the_command_line_runs_a_scripted_program_through_scenic(tmp_path):
    import mrta_falsify as mf
    from mrta_falsify.commands.worlds import find_world_and_scene
    from simulator_interface.scenic_bridge.simulator import simulate_scene

    path = tmp_path / "own.scenic"
    path.write_text(HEAD.replace("{horizon}", "3.0") + OWN + "param tasks = [(0, 1, 2, 99)]\n")
    start = find_world_and_scene(path, seed=2)
    outcome = mf.run(start, KINEMATIC)
    assert outcome.ended == "horizon"
    assert outcome.trace.digest == simulate_scene(start.scene, start.world, KINEMATIC).trace.digest
    with pytest.raises(WorldError, match="cannot be run without its Scenic program"):
        mf.run(start.world, KINEMATIC)


@pytest.mark.slow
def test_a_trial_of_a_scripted_program_runs_again_from_its_candidate(tmp_path):
    from mrta_falsify.campaigns.settings import TrialSettings
    from mrta_falsify.lab import Lab, experiment_of_record, open_program
    from mrta_falsify.worker import TrialRunner

    path = tmp_path / "own.scenic"
    path.write_text(HEAD.replace("{horizon}", "3.0") + OWN + "param tasks = [(0, 1, 2, 99)]\n")
    settings = TrialSettings(scenario=str(path), stack=KINEMATIC, specifications=("progress",))
    program = open_program(settings)
    record = TrialRunner(settings, program).run(0, np.full(len(program.space), 0.5))
    assert record.status == "ok"
    world = program.realise(record.candidate, mode=settings.mode).world
    again = Lab().judge(experiment_of_record(settings, record, world))
    assert again.outcome.trace.digest == record.trace_digest
