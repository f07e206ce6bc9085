"""The user's modules, one copy for each program, with the machine's clock and threads replaced.

A module of the user's is any under the given folders. What it imports by name comes from the usual
places, but for the modules that are replaced: ``time`` and ``threading``.
"""

from __future__ import annotations

import builtins
import importlib.machinery
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any


class PrivateModules:
    """Finds the user's modules; to be put first on ``sys.meta_path``.

    Args:
        folders: the user's modules are under.
        replaced: modules that they see in place of others, by name.
        patches: called with modules of the user's, by name, once they are loaded.
    """

    def __init__(
        self,
        folders: Sequence[str],
        replaced: Mapping[str, ModuleType],
        patches: Mapping[str, Callable[[ModuleType], object]],
    ) -> None:
        self.owned: dict[str, ModuleType] = {}  #: of the program that runs
        self._folders = [os.path.realpath(folder) for folder in folders]
        self._replaced = replaced
        self.patches = patches

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module of the user's; None: it is not one."""
        spec = PathFinder.find_spec(fullname, self._folders if path is None else path)
        if spec is None or not self._is_users(spec):
            return None
        if isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(fullname, spec.loader.path, self)
        return spec

    def note(self, name: str, module: ModuleType) -> None:
        """Take note that the program that runs has loaded a module."""
        self.owned[name] = module

    def builtins(self) -> dict[str, Any]:
        """Give the builtins of the user's modules: their imports see what is replaced."""
        return {**vars(builtins), "__import__": self._import}

    def _is_users(self, spec: ModuleSpec) -> bool:
        places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
        return any(
            os.path.realpath(place).startswith(folder + os.sep)
            for place in places
            for folder in self._folders
        )

    def _import(
        self,
        name: str,
        globals_: Mapping[str, object] | None = None,
        locals_: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        if level == 0 and name in self._replaced:
            return self._replaced[name]
        return builtins.__import__(name, globals_, locals_, fromlist or (), level)


class _Loader(SourceFileLoader):
    def __init__(self, name: str, path: str, modules: PrivateModules) -> None:
        super().__init__(name, path)
        self._modules = modules

    def exec_module(self, module: ModuleType) -> None:
        self._modules.note(module.__name__, module)
        vars(module)["__builtins__"] = self._modules.builtins()
        super().exec_module(module)
        patch = self._modules.patches.get(module.__name__)
        if patch is not None:
            patch(module)


def install(finder: PrivateModules | importlib.machinery.PathFinder | Any) -> None:
    """Ask a finder before all others."""
    sys.meta_path.insert(0, finder)
