"""The command ``allocate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import FILE
from mrta_falsify.cli.run_commands import main
from mrta_falsify.core.config import Choice, StackConfig, apply_setting

if TYPE_CHECKING:
    from mrta_falsify.verbs.allocate import Answer

MOST_LINES = 200  # stops printed as text; json prints all


@main.command()
@click.argument("tasks", type=FILE, metavar="TASKS.json")
@click.option(
    "--travel-times",
    "travel_times",
    type=FILE,
    required=True,
    metavar="T.json",
    help="Seconds from room to room, as `travel-times -o T.json` writes them.",
)
@click.option(
    "--allocator",
    "name",
    metavar="NAME",
    help="Registered name or module:Class. Default: insertion, then exact within a limit of "
    "nodes, then the best subset.",
)
@click.option(
    "--capacity", type=int, default=2, show_default=True, help="Loads that a robot carries."
)
@click.option(
    "--keep",
    is_flag=True,
    help="Only append to the plan when tasks arrive, as MRTA-Sim's dispatcher does; without it "
    "everything that has not begun may change.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="OPTION=VALUE",
    help="Option of the allocator, as objective=makespan. Repeatable.",
)
@click.option(
    "--format",
    "style",
    type=click.Choice(("text", "json", "smrta")),
    default="text",
    show_default=True,
    help="json and smrta print one object on stdout; smrta has SMrTa's agt, ts, td, t2a.",
)
def allocate(
    tasks: Path,
    travel_times: Path,
    name: str | None,
    capacity: int,
    keep: bool,
    settings: tuple[str, ...],
    style: str,
) -> int:
    """Plan which robot serves which task of a task file, and prove it where none can.

    Exit code 0: all deadlines are kept; 1: some are not, or it is proved that they cannot.
    """
    from mrta_falsify.verbs import allocate as verb

    answer = verb.allocate_file(
        tasks,
        travel_times,
        allocator=_choice(name or verb.DEFAULT_ALLOCATOR, settings),
        capacity=capacity,
        commitment="keep" if keep else "free",
    )
    if answer.shortened:
        output.say(
            f"warning: {travel_times}: {answer.shortened} travel times were longer than a way "
            "over other rooms and were shortened to it"
        )
    if style == "json":
        output.print_json(verb.as_data(answer))
    elif style == "smrta":
        output.print_json(answer.smrta)
    else:
        _print_plan(answer, verb.as_data(answer))
    return ExitCode.DONE if answer.status == "plan" else ExitCode.VIOLATED


def _choice(name: str, settings: tuple[str, ...]) -> Choice:
    config = StackConfig(allocator=Choice(name))
    for setting in settings:
        config = apply_setting(config, f"allocator.{setting}")
    return config.allocator


def _print_plan(answer: Answer, data: dict[str, Any]) -> None:
    out = output.stdout()
    lost, stops = data["late"], sum(len(robot["stops"]) for robot in data["robots"])
    out.print(f"status     {data['status']} in {1e3 * data['wall_s']:.1f} ms")
    out.print(f"tasks      {sum(map(len, answer.case.batches))}, {len(lost)} not in time")
    if data["reason"]:
        out.print(f"why        {data['reason']}")
    for robot in data["robots"] if stops <= MOST_LINES else ():
        parts = [
            f"{stop['action']} {stop['batch']}.{stop['task']} in {stop['room']} "
            f"at {stop['time_s']:g}"
            for stop in robot["stops"]
        ]
        out.print(f"robot {robot['robot']:<4} {'; '.join(parts) or 'idle'}")
    if stops > MOST_LINES:
        out.print(f"{stops} stops; --format json prints them all")
