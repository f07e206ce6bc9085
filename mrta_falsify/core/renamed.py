"""Old names of modules, attributes and keyword arguments: they still work, with one warning."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

#: modules that documentation named, and where their content is now
MODULES = {
    "mrta_falsify.bare_floor": "mrta_falsify.static_floor",
    "mrta_falsify.campaigns.attribution": "mrta_falsify.specs.attribution",
    "mrta_falsify.copies": "mrta_falsify.perturbed_runs",
    "mrta_falsify.rehearsal": "mrta_falsify.preflight",
    "mrta_falsify.specs.situations": "mrta_falsify.specs.descriptors",
}

P = ParamSpec("P")
R = TypeVar("R")


def renamed_keywords(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take keyword arguments by their old names, too.

    Args:
        names: old name -> name now.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> R:
            for old in names.keys() & keywords.keys():
                warnings.warn(
                    f"{function.__name__}: {old} is called {names[old]} now",
                    DeprecationWarning,
                    stacklevel=2,
                )
                keywords.setdefault(names[old], keywords.pop(old))
            return function(*args, **keywords)

        return call

    return decorate


def renamed_attribute(module: str, name: str, names: Mapping[str, str]) -> Any:
    """Give an attribute of a module by its old name; for the module's ``__getattr__``.

    Args:
        module: its name.
        name: that is asked for.
        names: old name -> name now.

    Raises:
        AttributeError: it is no old name either.
    """
    if name not in names:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    _warn(f"{module}.{name}", names[name], depth=4)
    return getattr(sys.modules[module], names[name])


def renamed_member(value: object, name: str, names: Mapping[str, str]) -> Any:
    """Give an attribute of a value by its old name; for the ``__getattr__`` of its class.

    Args:
        value: whose attribute it is.
        name: that is asked for.
        names: old name -> name now.

    Raises:
        AttributeError: it is no old name either.
    """
    kind = type(value).__name__
    if name not in names:
        raise AttributeError(f"{kind!r} object has no attribute {name!r}")
    _warn(f"{kind}.{name}", names[name], depth=4)
    return getattr(value, names[name])


def _warn(old: str, new: str, *, depth: int = 3) -> None:
    warnings.warn(f"{old} is called {new} now", DeprecationWarning, stacklevel=depth)


class RenamedModules(MetaPathFinder, Loader):
    """Imports a module by its old name."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See :class:`importlib.abc.MetaPathFinder`."""
        del path, target
        return ModuleSpec(fullname, self) if fullname in MODULES else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """See :class:`importlib.abc.Loader`."""
        _warn(spec.name, MODULES[spec.name])
        module = importlib.import_module(MODULES[spec.name])
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """See :class:`importlib.abc.Loader`; the module has been run, and keeps its own name."""
        module.__spec__ = self._spec
