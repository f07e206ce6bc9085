"""Start a bridge: ``--stack "exec:python -m simulator_interface.foreign.dds [CONFIG.yaml]"``."""

from __future__ import annotations

import sys
from pathlib import Path

from mrta_falsify.core.errors import ConfigError, InputError
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings, read_settings


def _start(arguments: list[str]) -> None:
    """Run a bridge for one episode.

    Args:
        arguments: at most the settings' file.
    """
    try:
        if len(arguments) > 1:
            raise ConfigError(f"one argument is allowed, the settings' file; given: {arguments}")
        settings = read_settings(Path(arguments[0])) if arguments else BridgeSettings()
        try:
            from simulator_interface.foreign.dds.bridge import run_bridge  # noqa: PLC0415 - extra
        except ImportError as error:
            raise ConfigError(
                f"the bridge needs the extra `ros`; in the checkout: pip install '.[ros]' ({error})"
            ) from None
        run_bridge(settings)
    except InputError as error:
        sys.exit(f"bridge: {error}")


_start(sys.argv[1:])
