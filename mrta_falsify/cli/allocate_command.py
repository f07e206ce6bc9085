"""The command ``allocate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import FILE
from mrta_falsify.core.words import clock_text, is_date, number_text

if TYPE_CHECKING:
    from mrta_falsify.commands.allocate import PlanSummary

MAX_LINES = 200  # stops printed as text; json prints all


@main.command("allocate")
@click.argument("tasks", type=FILE, metavar="TASKS.json")
@click.option(
    "--travel-times",
    type=FILE,
    required=True,
    metavar="T.json",
    help="Matrix of travel times [s] from room to room, as `travel-times -o T.json` writes it.",
)
@click.option(
    "--allocator",
    default="chain",
    show_default=True,
    metavar="NAME",
    help=(
        "Allocator: a registered name or module:Class. `chain` tries insertion, then `exact` "
        "within a limit of nodes, then the best subset."
    ),
)
@click.option(
    "--capacity",
    type=int,
    default=2,
    show_default=True,
    metavar="N",
    help="Number of loads that a robot can carry at once.",
)
@click.option(
    "--keep",
    is_flag=True,
    help=(
        "Append new tasks to the plan, as MRTA-Sim's dispatcher does. By default every stop "
        "that has not begun may change."
    ),
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="OPTION=VALUE",
    help="Option of the allocator, for example objective=makespan. Repeatable.",
)
@click.option(
    "--format",
    "style",
    type=click.Choice(("text", "json", "smrta")),
    default="text",
    show_default=True,
    help=(
        "Form of the output; json and smrta print one object on stdout, smrta with the keys of "
        "the solver SMrTa (agt, ts, td, t2a)."
    ),
)
def allocate_command(tasks: Path, travel_times: Path, style: str, **options: Any) -> int:
    """Plan which robot serves which task of a task file, or prove that no plan exists."""
    from mrta_falsify.commands.allocate import allocate, summarise_plan

    answer = allocate(tasks, travel_times, **options)
    if answer.shortened:
        output.say(
            f"warning: {travel_times}: {answer.shortened} travel times were longer than a way "
            "over other rooms and were shortened to it"
        )
    if style == "json":
        output.print_json(summarise_plan(answer))
    elif style == "smrta":
        output.print_json(answer.smrta)
    else:
        has_dates = is_date(min(answer.case.arrivals, default=0.0))
        tasks_given = sum(map(len, answer.case.batches))
        _print_plan(summarise_plan(answer), tasks=tasks_given, has_dates=has_dates)
    return ExitCode.DONE if answer.status == "plan" else ExitCode.VIOLATED


def _print_plan(plan: PlanSummary, *, tasks: int, has_dates: bool) -> None:
    out = output.stdout()
    stops = sum(len(robot.stops) for robot in plan.robots)
    out.print(f"status     {plan.status} in {1e3 * plan.wall_s:.1f} ms")
    out.print(f"tasks      {tasks}, {len(plan.late)} not in time")
    if plan.reason:
        out.print(f"why        {plan.reason}")
    for robot in plan.robots if stops <= MAX_LINES else ():
        parts = [
            f"{stop.action} {stop.batch}.{stop.task} in {stop.room} at "
            f"{_time(stop.time_s, has_dates)}"
            for stop in robot.stops
        ]
        out.print(f"robot {robot.robot:<4} {'; '.join(parts) or 'idle'}")
    if stops > MAX_LINES:
        out.print(f"{stops} stops; --format json prints them all")


def _time(seconds: float, has_dates: bool) -> str:
    """Write a time, with the hours of the day if the file counts seconds since 1970."""
    return f"{number_text(seconds)} ({clock_text(seconds)})" if has_dates else number_text(seconds)
