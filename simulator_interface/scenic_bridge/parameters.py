"""How a Scenic program asks to be run: its global parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig, apply_setting, read_config
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.specs.library import default_specifications


@dataclass(frozen=True, slots=True, kw_only=True)
class RunParameters:
    """How a program asks to be run."""

    config: StackConfig
    specifications: tuple[str, ...]
    seed: int
    output: Path | None  #: folder for the files of each run


def read_parameters(params: dict[str, Any]) -> RunParameters:
    """Read how a scene asks to be run from its global parameters.

    Args:
        params: ``stack`` (path of a stack file), ``settings`` (texts as of ``--set``),
            ``engine`` (its name), ``specs`` (names), ``seed``, ``output`` (folder);
            all may be missing.

    Raises:
        InputError: a parameter has a value that is not allowed.
    """
    config = StackConfig()
    if params.get("stack"):
        config = read_config(Path(str(params["stack"])))
    for setting in _texts(params.get("settings"), "settings"):
        config = apply_setting(config, setting)
    if params.get("engine"):
        config = apply_setting(config, f"engine={params['engine']}")
        registry.load("engine", config.engine.name, where="param engine")
    output = params.get("output")
    return RunParameters(
        config=config,
        specifications=_texts(params.get("specs"), "specs") or default_specifications(),
        seed=_whole(params.get("seed", 0), "seed"),
        output=Path(str(output)) if output else None,
    )


def _whole(value: Any, name: str) -> int:
    if not isinstance(value, (int, float)) or value != int(value) or value < 0:
        raise ConfigError(f"param {name} is {value!r}; it must be a whole number >= 0")
    return int(value)


def _texts(value: Any, name: str) -> tuple[str, ...]:
    if not value:
        return ()
    if isinstance(value, str):
        return tuple(part.strip() for part in value.split(",") if part.strip())
    if isinstance(value, (list, tuple)) and all(isinstance(part, str) for part in value):
        return tuple(value)
    raise ConfigError(f"param {name} is {value!r}; it must be text, or a list of texts")
