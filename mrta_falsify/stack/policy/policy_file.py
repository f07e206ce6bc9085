"""Policies in files: a Python function, or the weights of a perceptron. Never a pickle."""

from __future__ import annotations

import importlib.util
import itertools
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core.archives import DAMAGE, read_array
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.parsing import refuse_pipe
from mrta_falsify.stack.policy.observation import ACTIONS, SIZE, Observations

#: from one robot's observation ``(SIZE,)`` to its action ``(2,)``: shares of speed and turn rate
Policy = Callable[[Observations], Any]

FUNCTION = "act"  # name of the function in a Python file, unless another is named


def load_policy(file: str) -> Policy:
    """Load a policy.

    Args:
        file: ``FILE.py`` with a function ``act``, ``FILE.py:NAME``, or ``FILE.npz`` with weights.

    Raises:
        FormatError: there is no such file, or it holds no policy.
    """
    path, _, name = file.partition(":")
    if Path(path).suffix not in (".py", ".npz"):
        raise FormatError(f"policy {file!r}: must be FILE.py, FILE.py:NAME or FILE.npz")
    if not Path(path).is_file():
        raise FormatError(f"policy {file!r}: there is no such file; looked in {Path.cwd()}")
    if path.endswith(".npz"):
        return read_perceptron(Path(path))
    return _read_function(Path(path), name or FUNCTION)


def _read_function(path: Path, name: str) -> Policy:
    spec = importlib.util.spec_from_file_location(f"policy_in_{path.stem}", path)
    assert spec is not None, "a .py file has a loader"
    assert spec.loader is not None, "a .py file has a loader"
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise FormatError(f"{path}: cannot be loaded: {type(error).__name__}: {error}") from error
    found = getattr(module, name, None)
    if not callable(found):
        raise FormatError(f"{path}: has no function {name!r}; it must have `{name}(observation)`")
    policy: Policy = found
    return policy


@dataclass(frozen=True, slots=True, eq=False)
class Perceptron:
    """Layers of weights with tanh behind each, also behind the last."""

    weights: tuple[Array, ...]  #: each (out, in); the first in is SIZE, the last out 2
    biases: tuple[Array, ...]  #: each (out,)
    mean: Array  #: (SIZE,) taken from the observation
    scale: Array  #: (SIZE,) by which the rest is divided

    def __call__(self, observation: Observations) -> Array:
        """Compute the action ``(2,)``."""
        value: Array = (observation - self.mean) / self.scale
        for weight, bias in zip(self.weights, self.biases, strict=True):
            value = np.tanh(weight @ value + bias)
        return value


def read_perceptron(path: Path) -> Perceptron:
    """Read ``weight_0``, ``bias_0``, ``weight_1``, ... and, if there, ``mean`` and ``scale``.

    Raises:
        FormatError: an array is missing, has another shape, or is not finite.
    """
    refuse_pipe(path)
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
            arrays = {name: read_array(archive, name).astype(np.float64) for name in names}
    except DAMAGE as error:
        text = " ".join(str(error).split())[:200]
        raise FormatError(f"{path}: is no archive of numbers: {text}") from None
    depth = next(k for k in itertools.count() if f"weight_{k}" not in arrays)
    if not depth:
        raise FormatError(f"{path}: has no weight_0; it has {', '.join(sorted(arrays)) or 'none'}")
    arrays = {"mean": np.zeros(SIZE), "scale": np.ones(SIZE)} | arrays
    size = SIZE
    for k in range(depth):
        last = k == depth - 1
        rows = ACTIONS if last else len(np.atleast_1d(arrays[f"weight_{k}"]))
        _check(path, arrays, f"weight_{k}", (rows, size))
        _check(path, arrays, f"bias_{k}", (rows,))
        size = rows
    for name in ("mean", "scale"):
        _check(path, arrays, name, (SIZE,))
    if not arrays["scale"].all():
        raise FormatError(f"{path}: scale has a 0")
    return Perceptron(
        weights=tuple(arrays[f"weight_{k}"] for k in range(depth)),
        biases=tuple(arrays[f"bias_{k}"] for k in range(depth)),
        mean=arrays["mean"],
        scale=arrays["scale"],
    )


def _check(path: Path, arrays: dict[str, Array], name: str, shape: tuple[int, ...]) -> None:
    if name not in arrays:
        raise FormatError(f"{path}: has no {name}")
    if arrays[name].shape != shape:
        raise FormatError(f"{path}: {name} has shape {arrays[name].shape}; it must be {shape}")
    if not np.isfinite(arrays[name]).all():
        raise FormatError(f"{path}: {name} is not finite")
