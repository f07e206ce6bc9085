"""Names that a shell can complete; the commands themselves read them as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import click
from click.shell_completion import CompletionItem


class Name(click.types.StringParamType):
    """Text for which there are known names.

    Args:
        known: lists them; called when a shell asks.
        or_file: whether a file's name may stand in their place.
    """

    def __init__(self, known: Callable[[], Iterable[str]], *, or_file: bool = False) -> None:
        self._known, self._or_file = known, or_file

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """List the names that begin like that; without any, the shell looks for files."""
        files = [CompletionItem(incomplete, type="file")] if self._or_file else []
        known = [name for name in self._known() if name.startswith(incomplete)]
        return files + [CompletionItem(name) for name in known]


def component(point: str) -> Name:
    """Name a component of an extension point."""

    def known() -> Iterable[str]:
        from mrta_falsify.core import registry

        return registry.names(point)

    return Name(known)


def _scenarios() -> Iterable[str]:
    from scenic_worlds.shipped import scenario_names

    return scenario_names()


def _worlds() -> Iterable[str]:
    from scenic_worlds import layouts, zoo

    scenes = (f"{zoo.PREFIX}{name}" for name in zoo.scene_names())
    return (*layouts.world_names(), *_scenarios(), *scenes)


SCENARIO = Name(_scenarios, or_file=True)
WORLD = Name(_worlds, or_file=True)
