"""The command ``import``."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import FILE, FiniteRange, format_option, output_option
from mrta_falsify.core.claims import claim_kind
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.words import clock_text, date_text

if TYPE_CHECKING:
    from mrta_falsify.commands.floor_import import ImportedFloor, ImportedRoom
    from mrta_falsify.commands.incident.importing import Confirmation, ImportedLog

SUSPECTED = {"deadlock": "a deadlock of", "stuck": "to be stuck:"}  # what a log shows, by kind

DEFAULT_RADIUS = 0.22  # m; the verb's, whose module takes a while to load


@main.command("import")
@click.argument("map", type=FILE)
@click.option(
    "--rooms",
    type=FILE,
    metavar="FILE",
    help="YAML file with the rooms; default: NAME.rooms.yaml beside the map.",
)
@click.option("--level", metavar="NAME", help="Level of an Open-RMF building that has several.")
@click.option(
    "--radius",
    type=FiniteRange(0.05, 1.0),
    default=DEFAULT_RADIUS,
    show_default=True,
    metavar="M",
    help="Radius of the largest robot [m].",
)
@click.option(
    "--floor", type=FILE, help="Floor or map of the building, in place of the map in the log."
)
@click.option(
    "--stack",
    metavar="STACK",
    help=(
        "Stack to run the incident of a log on: a YAML file, `default`, exec:CMD or "
        "connect:ADDRESS."
    ),
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="K=V",
    help="Layer or option of that stack to change, for example planner=ompl. Repeatable.",
)
@output_option("DIR", "Directory for NAME.scenic and the files that it needs.", required=True)
@format_option
def import_command(map: Path, style: str, **options: Any) -> int:
    """Make a scenario of a building's map, or of a log of a fleet.

    Of a Nav2 map and a file of rooms, a floor: roadways, waiting spots and parking are derived.
    MAP may also be an SDF world, a floor file, or an Open-RMF building (NAME.building.yaml),
    whose lanes are kept. Of a log (a rosbag2 folder, a folder of several bags of one run, an .mcap
    or .db3 file, or a run's folder): who waited for whom, and the worlds near by.
    """
    from mrta_falsify.commands.incident.logs import is_log

    is_of_log = is_log(map)
    names = ("rooms", "level") if is_of_log else ("floor", "stack", "settings")
    given = [name for name in names if options.pop(name)]
    if given:
        what, other = ("map", "log") if is_of_log else ("log", "map")
        name = "set" if given[0] == "settings" else given[0]
        raise ConfigError(f"--{name} is for a {what}; {map} is taken for a {other}")
    return _import_log(map, style, **options) if is_of_log else _import_map(map, style, **options)


def _import_log(log: Path, style: str, **options: Any) -> int:
    from mrta_falsify.commands.incident.importing import import_log

    done = import_log(log, **options)
    if style == "json":
        output.print_json(done)
        return ExitCode.DONE
    _print_log(done)
    for note in done.notes:
        output.say(f"note: {note}")
    output.say(f"wrote {done.scenario}")
    output.say(f"wrote {done.world}")
    _say_next(f"run {shlex.quote(str(done.world))}", done.scenario)
    return ExitCode.DONE


def _print_log(done: ImportedLog) -> None:
    out = output.stdout()
    begins = "" if done.begins_at is None else f", from {date_text(done.begins_at)} on"
    out.print(f"log       {done.duration_s:.0f} s, {len(done.robots)} robots{begins}")
    out.print(f"goals     {'; '.join(done.goals)}")
    if done.suspected:
        since = "" if done.onset_s is None else f", since {done.onset_s:.1f} s"
        if done.onset_s is not None and done.begins_at is not None:
            since += f" ({clock_text(done.begins_at + done.onset_s)})"
        what = SUSPECTED[claim_kind({"members": done.suspected})]
        out.print(f"suspected {what} {', '.join(done.suspected)}{since}")
        for line in done.waits:
            out.print(f"          {line}")
    elif done.doubts:
        out.print("suspected no deadlock, but the log does not tell enough to rule one out:")
        for doubt in done.doubts:
            out.print(f"          {doubt}")
    else:
        out.print("suspected nothing: no robots stood for 30 s because of each other")
    out.print(f"scenario  from {done.begin_s:.1f} s of the log on, {done.tasks} tasks")
    if done.confirmed is not None:
        out.print(f"on stack  {_confirmed_text(done.confirmed)}")


def _confirmed_text(done: Confirmation) -> str:
    if not done.deadlock:
        return f"no deadlock; {done.delivered} of {done.tasks} tasks delivered"
    same = "confirmed" if done.same else "of other robots than in the log"
    what = {"deadlock": "a deadlock of", "stuck": "stuck:", "shut": "shut by the world:"}
    return f"{what[done.kind]} {', '.join(done.members)} ({same})"


def _import_map(map: Path, style: str, **options: Any) -> int:
    from mrta_falsify.commands.floor_import import import_floor

    with output.progress(f"import {map.name}", 1, "steps") as on_progress:
        done = import_floor(map, **options, on_progress=on_progress)
    if style == "json":
        output.print_json(done)
        return ExitCode.DONE
    _print_floor(done)
    for thing in done.left_out:
        output.say(f"no counterpart: {thing}")
    for warning in done.warnings:
        output.say(f"note: {warning}")
    for path in filter(None, (done.floor, done.picture, done.derived)):
        output.say(f"wrote {path}")
    verb = "left as it is:" if done.scenario_kept else "wrote"
    output.say(f"{verb} {done.scenario}")
    sized = done.robot_radius != DEFAULT_RADIUS
    stack = f" --set costmap.robot_radius={done.robot_radius:g}" if sized else ""
    _say_next(f"check {shlex.quote(str(done.scenario))}", done.scenario, stack)
    return ExitCode.DONE


def _say_next(command: str, scenario: Path, options: str = "") -> None:
    """Say what to try with what was written: a command, then a campaign."""
    runs = shlex.quote(f"runs/{scenario.stem}")
    output.say(f"try: mrta-falsify {command}")
    output.say(f"then: mrta-falsify campaign {shlex.quote(str(scenario))}{options} -o {runs}")


def _print_floor(done: ImportedFloor) -> None:
    out = output.stdout()
    width, depth = done.size
    out.print(f"floor     {width:.1f} x {depth:.1f} m, {done.walls} walls")
    if done.map is not None:
        facts = done.map
        turned = f", turned by {math.degrees(facts.yaw):.1f} deg" if facts.yaw else ""
        out.print(
            f"map       {facts.cols} x {facts.rows} cells of {facts.resolution:g} m{turned}; "
            f"{facts.free:.0%} free, {facts.unknown:.0%} unknown; {facts.specks} specks, "
            f"{facts.left_out} patches left out"
        )
    given = f" ({done.lanes_given} given)" if done.lanes_given else ""
    out.print(
        f"roadways  {done.lanes} lanes{given}, the longest trip takes {done.longest_travel_s:.0f} s"
    )
    places = "1 place" if done.parking == 1 else f"{done.parking} places"
    out.print(f"parking   {places}{' (given)' if done.parking_given else ''}")
    out.print()
    table = output.new_table("room", "at [m]", "door [m]", "waiting spots", whole=("room",))
    for room in done.rooms:
        table.add_row(*_row(room))
    output.print_table(table)


def _row(room: ImportedRoom) -> tuple[str, str, str, str]:
    x, y = room.point
    door = "open" if room.door is None else f"{room.door:.2f}"
    return room.name, f"{x:.2f}, {y:.2f}", door, f"{room.spots}{' (given)' * room.spots_given}"
