"""The actions that library behaviours take: people go on with their scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scenic.core.dynamics.actions import Action

if TYPE_CHECKING:
    from simulator_interface.people.scripts import Script


class CarryOn(Action):  # type: ignore[misc]
    """Go on with a script for one Scenic time step; a person without this action stands."""

    def __init__(self, script: Script) -> None:
        self.script = script

    def canBeTakenBy(self, agent: Any) -> bool:  # noqa: N802
        """Whether ``agent`` is a person or scripted robot; the fleet belongs to the stack."""
        return getattr(agent, "kind", "") in ("human", "robot")

    def applyTo(self, agent: Any, simulation: Any) -> None:  # noqa: N802
        """See Scenic's ``Action``."""
        simulation.carry_on(agent, self.script)

    def __repr__(self) -> str:
        if self.script.done:
            return "CarryOn(done)"
        return f"CarryOn({self.script.directives[self.script.index].kind})"


def script(name: str, *args: Any, **options: Any) -> Script:
    """Begin the script of a library behaviour; called by the behaviours themselves."""
    from scenic.syntax import veneer  # noqa: PLC0415 - Scenic's state while it simulates

    simulation: Any = veneer.currentSimulation
    made: Script = simulation.script_of(veneer.currentBehavior, name, args, options)
    return made
