"""Travel times between rooms, measured by driving one robot with the full stack."""

from __future__ import annotations

import csv
import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import append, naming, write_atomically
from mrta_falsify.core.errors import ConfigError, FormatError, InputError, WorldError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.interruption import describe_interrupt
from mrta_falsify.core.parsing import read_text
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import RobotSpec, Task, World, without_actors
from mrta_falsify.specs.books import Ledger
from reports.sentences import violation_sentence
from scenic_worlds.variation import vary_world
from simulator_interface.simulate import simulate

LONGEST_TRIP = 900.0  # s; a trip that takes longer counts as no way
STATISTICS = {
    "max": lambda samples: float(np.max(samples)),
    "mean": lambda samples: float(np.mean(samples)),
    "p95": lambda samples: float(np.percentile(samples, 95.0)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TravelTimes:
    """Measured trips between R rooms."""

    rooms: tuple[str, ...]  #: names, by room number
    samples: dict[tuple[int, int], tuple[float, ...]]  #: (start, end) room -> seconds, may be empty

    def __post_init__(self) -> None:
        for start, end in self.samples:
            for room in (start, end):
                if not 0 <= room < len(self.rooms):
                    raise FormatError(
                        f"a trip is from room {start} to {end}; rooms are 0 to "
                        f"{len(self.rooms) - 1}"
                    )

    def matrix(self, statistic: str) -> Array:
        """Take "max", "mean" or "p95" of each pair: ``(R, R)`` [s], nan where there is no way."""
        times = np.zeros((len(self.rooms), len(self.rooms)))
        for (start, end), samples in self.samples.items():
            times[start, end] = STATISTICS[statistic](samples) if samples else np.nan
        return frozen_array(times)

    def missing(self) -> list[tuple[int, int]]:
        """List pairs of rooms without a way."""
        return [pair for pair, samples in sorted(self.samples.items()) if not samples]


def write_travel_times(
    world: World | Place,
    output: Place,
    *,
    iterations: int = 3,
    statistic: str = "max",
    seed: int = 0,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    on_progress: Callable[[float], None] | None = None,
) -> TravelTimes:
    """Measure travel times between all pairs of rooms and write them.

    An interrupted measurement goes on where it stopped.

    Args:
        world: a world, or a file or name of one.
        output: ``FILE.csv`` gets the raw samples, ``FILE.json`` the matrix that ``allocate`` reads.
        iterations: trips per pair of rooms.
        statistic: what the JSON file holds per pair, ``max``, ``mean`` or ``p95``.
        seed: of the start offsets.
        stack: the stack that drives, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        on_progress: called with the number of finished pairs.

    Raises:
        InputError: fewer than two rooms, another suffix or statistic, or the samples beside
            ``output`` belong to another measurement.
    """
    path = Path(output)
    if path.suffix not in (".csv", ".json"):
        raise ConfigError(f"-o {path}: the file must end in .csv or .json")
    if statistic not in STATISTICS:
        raise ConfigError(f"statistic is {statistic!r}; it must be one of {', '.join(STATISTICS)}")
    config = load_stack(stack, settings)
    found = find_world(world)
    make_directory(path.parent)
    times = measure_travel_times(
        found,
        config,
        iterations=iterations,
        seed=seed,
        samples_file=samples_file(path),
        on_progress=on_progress,
    )
    if path.suffix == ".json":
        write_matrix(times, path, statistic)
    return times


def measure_travel_times(
    world: World,
    config: StackConfig | None = None,
    *,
    iterations: int = 3,
    seed: int = 0,
    samples_file: Path | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> TravelTimes:
    """Drive one robot from every room to every other, alone on the floor.

    A trip lasts from the end of the pick-up in one room to the drop-off in the other.

    Args:
        world: rooms, lanes and obstacles; its robots, people, tasks and events stay away.
        config: the stack that drives.
        iterations: trips per pair; each starts within 0.2 m of the room point.
        seed: of the start offsets.
        samples_file: CSV that gets a line per finished pair; pairs already there are kept.
        on_progress: called with the number of finished pairs.

    Returns:
        All samples [s].

    Raises:
        InputError: fewer than two rooms, or ``samples_file`` belongs to another measurement.
        Interrupted: Ctrl-C; finished pairs are kept in ``samples_file``.
    """
    rooms = len(world.rooms)
    if rooms < 2:
        raise WorldError(f"rooms has {rooms} entries; travel times need at least 2")
    config = config or StackConfig()
    title = _title(world, config, seed, iterations)
    samples = _read_samples(samples_file, title) if samples_file is not None else {}
    names = tuple(room.name for room in world.rooms)
    try:
        TravelTimes(rooms=names, samples=samples)
    except FormatError as error:
        raise FormatError(f"{samples_file}: {error}; move it away") from None
    if samples_file is not None and not samples:
        write_atomically(samples_file, (title + "\n").encode())
    pairs = [(start, end) for start in range(rooms) for end in range(rooms) if start != end]

    def state() -> tuple[str, str]:
        kept = f"{len(samples) if samples_file is not None else 0} of {len(pairs)} pairs of rooms"
        return kept, "the travel times are not complete; the same command goes on"

    with describe_interrupt(state):
        for number, (start, end) in enumerate(pairs):
            if (start, end) not in samples:
                first = number * iterations
                seeds = [candidate_seed(seed, first + i) for i in range(iterations)]
                trips = [_drive(world, config, start, end, one) for one in seeds]
                samples[start, end] = tuple(time for time in trips if time is not None)
                if samples_file is not None:
                    _append_samples(samples_file, start, end, samples[start, end])
            if on_progress is not None:
                on_progress(number + 1)
    return TravelTimes(rooms=names, samples=samples)


class _TripClock:
    """A specification that judges nothing, but notes when the load came on and off."""

    def start(self, world: World, dt: float) -> None:
        del dt
        self._ledger = Ledger(world)

    def update(self, frame: Frame) -> None:
        self._ledger.enter(frame.confirmed, frame.sensed.time)

    @property
    def trip(self) -> float | None:
        """Time from pick-up to delivery [s]; None: there was none."""
        picked, delivered = self._ledger.picked, self._ledger.delivered
        return delivered[0] - picked[0] if delivered else None

    def verdict(self) -> Verdict:
        return Verdict(spec="trip", robustness=0.0, violated=False)


def _drive(world: World, config: StackConfig, start: int, end: int, seed: int) -> float | None:
    """Drive one trip and return its time [s]; None if the robot did not arrive."""
    clock = _TripClock()
    outcome = simulate(
        vary_world(_trip_world(world, start, end), seed),
        config,
        specifications=[clock],
        keep_trace=False,
        stop=lambda frame: "decided" if _is_given_up(frame) else "",
    )
    failures = [verdict for verdict in outcome.verdicts if verdict.spec == "stack_runs"]
    if failures:
        raise InputError(
            f"{world.name}: no travel time from room {start} to room {end}: "
            f"{violation_sentence(failures[0])}"
        )
    return None if clock.trip is None else round(clock.trip, 6)


def _is_given_up(frame: Frame) -> bool:
    return any(event.kind == "no-path" for event in frame.events)


def _trip_world(world: World, start: int, end: int) -> World:
    kind = (
        world.robots[0] if world.robots else RobotSpec(name="robot1", pose=frozen_array([0, 0, 0]))
    )
    at_home = [robot for robot in world.robots if _is_at(robot, world, start)]
    yaw = at_home[0].pose[2] if at_home else 0.0
    robot = dataclasses.replace(
        kind, pose=frozen_array([*world.rooms[start].point, yaw]), joins_at=0.0
    )
    return dataclasses.replace(
        without_actors(world),
        robots=(robot,),
        tasks=(Task(arrival=0.0, start=start, end=end, deadline=LONGEST_TRIP),),
        horizon=LONGEST_TRIP,
    )


def _is_at(robot: RobotSpec, world: World, room: int) -> bool:
    return bool(np.hypot(*(robot.pose[:2] - world.rooms[room].point)) < 1.0)


# --- files -----------------------------------------------------------------------------


def samples_file(path: Path) -> Path:
    """Name the file for the raw samples of an output file: the CSV itself, or one beside it."""
    return path if path.suffix == ".csv" else path.with_suffix(".samples.csv")


def write_matrix(times: TravelTimes, path: Path, statistic: str) -> None:
    """Write ``{units, rooms, statistic, travel_time}`` as JSON; null where there is no way."""
    rows = [
        [None if np.isnan(value) else float(value) for value in row]
        for row in times.matrix(statistic)
    ]
    data = {"units": "s", "rooms": times.rooms, "statistic": statistic, "travel_time": rows}
    write_atomically(path, (json.dumps(data, indent=1) + "\n").encode())


def _title(world: World, config: StackConfig, seed: int, iterations: int) -> str:
    floor = codec.digest(without_actors(world))[:16]
    return (
        f"# start room, end room, seconds of each trip; floor {floor} "
        f"stack {config.digest()[:16]} seed {seed} iterations {iterations}"
    )


def _read_samples(path: Path, title: str) -> dict[tuple[int, int], tuple[float, ...]]:
    if not path.exists():
        return {}
    lines = read_text(path).splitlines(keepends=True)
    if not lines or lines[0].strip() != title:
        raise FormatError(
            f"{path}: holds another measurement (other world, stack, seed or iterations); "
            "move it away or choose another file"
        )
    # A line without its end was cut off by an interruption: measure that pair again.
    whole = [line for line in lines[1:] if line.endswith("\n")]
    if len(whole) < len(lines) - 1:
        write_atomically(path, "".join([lines[0], *whole]).encode())
    try:
        rows = [(int(row[0]), int(row[1]), tuple(map(float, row[2:]))) for row in csv.reader(whole)]
    except (ValueError, IndexError, csv.Error):
        raise FormatError(f"{path}: is not a table of travel times; move it away") from None
    for line, (_, _, times) in enumerate(rows, start=2):
        if not all(0.0 <= time <= LONGEST_TRIP for time in times):
            raise FormatError(f"{path}:{line}: has a time that is not from 0 to {LONGEST_TRIP:g} s")
    return {(start, end): times for start, end, times in rows}


def _append_samples(path: Path, start: int, end: int, samples: tuple[float, ...]) -> None:
    line = ",".join(map(str, (start, end, *samples))) + "\n"
    with naming(path), path.open("ab", buffering=0) as file:
        append(file.fileno(), line.encode())
