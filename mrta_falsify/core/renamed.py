"""Old names of modules, attributes and keyword arguments: they still work, with one warning."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import operator
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import ModuleSpec
from types import CodeType, ModuleType
from typing import Any, ParamSpec, TypeAlias, TypeVar, cast

#: modules that documentation named, and where their content is now; of a package with all in it
MODULES = {
    "mrta_falsify.bare_floor": "mrta_falsify.static_floor",
    "mrta_falsify.campaigns.attribution": "mrta_falsify.specs.attribution",
    "mrta_falsify.copies": "mrta_falsify.perturbed_runs",
    "mrta_falsify.rehearsal": "mrta_falsify.preflight",
    "mrta_falsify.specs.situations": "mrta_falsify.specs.descriptors",
    "mrta_falsify.verbs": "mrta_falsify.commands",
    "mrta_falsify.verbs.certify": "mrta_falsify.analysis.certify",
    "mrta_falsify.verbs.certify.stored": "mrta_falsify.commands.certificates",
    "mrta_falsify.verbs.explain": "mrta_falsify.analysis.explain",
    "mrta_falsify.verbs.minimize": "mrta_falsify.analysis.minimize",
}

#: what says now what a name said, and how it is asked of the owner
Said: TypeAlias = tuple[str, Callable[[Any], Any]]

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
                _warn(f"{function.__name__}({old}=...)", names[old])
                keywords.setdefault(names[old], keywords.pop(old))
            return function(*args, **keywords)

        return call

    return decorate


def renamed_attribute(owner: object, name: str, names: Mapping[str, str | Said]) -> Any:
    """Give an attribute by its old name; for the ``__getattr__`` of a class or a module.

    Args:
        owner: the value, or the module.
        name: that is asked for.
        names: old name -> name now, with dots where it is an attribute of another one; or, where no
            name is left, what says the same now, with how it is asked of the owner.

    Raises:
        AttributeError: it is no old name either.
    """
    who = owner.__name__ if isinstance(owner, ModuleType) else type(owner).__name__
    if name not in names:
        raise AttributeError(f"{who!r} has no attribute {name!r}")
    new = names[name]
    text, ask = (new, operator.attrgetter(new)) if isinstance(new, str) else new
    _warn(f"{who}.{name}", text, depth=4)
    return ask(owner)


def _warn(old: str, new: str, *, depth: int = 3) -> None:
    warnings.warn(f"{old} is called {new} now", DeprecationWarning, stacklevel=depth)


def _name_now(module: str) -> str:
    """Give the name that a module has now; empty if it is not an old one's."""
    if not module.startswith("mrta_falsify."):
        return ""
    parts = module.split(".")
    for count in range(len(parts), 1, -1):
        now = MODULES.get(".".join(parts[:count]))
        if now is not None:
            return ".".join([now, *parts[count:]])
    return ""


class RenamedModules:
    """Imports a module by its old name: finder and loader of :mod:`importlib`.

    It does not derive from their abstract classes, whose module every import would have to load.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See :class:`importlib.abc.MetaPathFinder`."""
        del path, target
        now, loader = _name_now(fullname), cast("Any", self)
        if not now or importlib.util.find_spec(now) is None:
            return None
        return ModuleSpec(fullname, loader)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """See :class:`importlib.abc.Loader`."""
        now = _name_now(spec.name)
        _warn(spec.name, now)
        module = importlib.import_module(now)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """See :class:`importlib.abc.Loader`; the module has been run, and keeps its own name."""
        module.__spec__ = self._spec

    def get_code(self, fullname: str) -> CodeType | None:
        """Give the code for ``python -m`` with an old name."""
        now = _name_now(fullname)
        _warn(fullname, now)
        found: Any = importlib.util.find_spec(now)
        code: CodeType | None = found.loader.get_code(now)
        return code
