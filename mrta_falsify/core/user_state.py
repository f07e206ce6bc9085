"""What this user keeps on this machine: a secret key, and digests of foreign code that is trusted.

Both lie in ``$XDG_STATE_HOME/mrta-falsify`` (``~/.local/state/mrta-falsify``), outside every
campaign, readable by nobody else.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from pathlib import Path

FOLDER = "mrta-falsify"
KEY, TRUSTED = "key", "trusted"  # files in it
KEY_BYTES = 32
PRIVATE = 0o077  # permissions that nobody else may have


def state_folder() -> Path:
    """Name the folder; it need not exist.

    Of a user without a home it is nowhere, so that such a user has no key.
    """
    given = os.environ.get("XDG_STATE_HOME", "")
    home = os.path.expanduser("~")
    base = given if os.path.isabs(given) else os.path.join(home, ".local", "state")
    return Path(base if os.path.isabs(base) else os.devnull) / FOLDER


def secret_key(*, make: bool = False) -> bytes | None:
    """Read the user's key.

    Args:
        make: make one if there is none.

    Returns:
        None if there is none, or if somebody else could have read or written it.
    """
    path = state_folder() / KEY
    data = _private_bytes(path)
    if data is None and make and not path.exists():
        with contextlib.suppress(OSError):  # a home that does not exist or is full
            _make_key(path)
        data = _private_bytes(path)
    return data if data is not None and len(data) == KEY_BYTES else None


def _make_key(path: Path) -> None:
    """Write a new key whole; of two processes that do so at a time, one wins."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    part = path.with_name(f"{KEY}.{os.getpid()}.part")
    try:
        _write_private(part, secrets.token_bytes(KEY_BYTES), os.O_TRUNC)
        with contextlib.suppress(FileExistsError):
            try:
                os.link(part, path)
            except PermissionError:  # a file system without links
                os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def trusted_digests() -> frozenset[str]:
    """Read the digests of foreign code that the user has trusted."""
    data = _private_bytes(state_folder() / TRUSTED)
    return frozenset((data or b"").decode("ascii", "replace").split())


def remember(digest: str) -> bool:
    """Keep the digest of foreign code that the user trusts; False if it cannot be kept."""
    path = state_folder() / TRUSTED
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _write_private(path, f"{digest}\n".encode(), os.O_APPEND)
    except OSError:
        return False
    return digest in trusted_digests()


def _write_private(path: Path, data: bytes, how: int) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC | how, 0o600)
    try:
        os.write(handle, data)
        os.fsync(handle)
    finally:
        os.close(handle)


def _private_bytes(path: Path) -> bytes | None:
    """Read a file of this user's own; None if there is none, or others have a hand in it."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        about = os.fstat(handle)
        is_own = stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid()
        return file.read() if is_own and not about.st_mode & PRIVATE else None
