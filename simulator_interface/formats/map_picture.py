"""Pictures of maps: PGM, PNG and BMP as brightness per pixel, within limits."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import BoolArray
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.parsing import refuse_pipe

if TYPE_CHECKING:
    from PIL.Image import Image

ENDINGS = (".pgm", ".png", ".bmp")  # what Nav2's map saver writes
DECODERS = ("PPM", "PNG", "BMP")  # of Pillow; its others never see a user's file
MAX_CELLS = 16_000_000  # 200 m x 200 m at 0.05 m; traffic is planned on every cell
BRIGHTEST = 255  # of one channel


class MapPicture(NamedTuple):
    """How bright every pixel is, northernmost row first."""

    sums: NDArray[np.uint16]  #: (rows, cols) sum over the channels
    brightest: int  #: the largest sum that there can be
    see_through: BoolArray | None  #: (rows, cols) not wholly opaque; None: no alpha channel


def read_map_picture(path: Path, *, with_alpha: bool, where: str) -> MapPicture:
    """Read a picture.

    Args:
        path: by its ending, a ``.pgm``, ``.png`` or ``.bmp`` file of 8 bits per channel.
        with_alpha: count opacity as one more channel where there is one, as Nav2 does in
            mode ``trinary``.
        where: what errors about the file's name begin with.

    Raises:
        FormatError: no such picture, more than ``MAX_CELLS`` pixels, or a broken file.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - maps are read seldom

    if path.suffix.lower() not in ENDINGS:
        raise FormatError(
            f"{where} is {path.name!r}; it must be a {', '.join(ENDINGS)} file (convert it first)"
        )
    refuse_pipe(path)
    try:
        with warnings.catch_warnings():
            # Pillow's own limit; ours is lower, and checked before any pixel is decoded.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture = Image.open(path, formats=DECODERS)
            with picture:
                _check_size(picture, path)
                return _brightness(picture, path, with_alpha=with_alpha)
    except Image.DecompressionBombError:
        raise FormatError(f"{path}: has too many pixels; 1 to {MAX_CELLS} are allowed") from None
    except UnidentifiedImageError:
        raise FormatError(f"{path}: is not a picture (PGM, PNG or BMP)") from None
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        if isinstance(error, OSError) and error.strerror:
            raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
        raise FormatError(f"{path}: is a broken picture: {error}") from None


def _check_size(picture: Image, path: Path) -> None:
    cols, rows = picture.size
    if not 0 < rows * cols <= MAX_CELLS:
        raise FormatError(
            f"{path}: has {cols} x {rows} = {cols * rows} pixels; 1 to {MAX_CELLS} are allowed "
            "(crop it, or save the map with a coarser resolution)"
        )


def _brightness(picture: Image, path: Path, *, with_alpha: bool) -> MapPicture:
    if picture.mode.startswith(("I", "F")):
        raise FormatError(f"{path}: has more than 8 bits per channel; save it with 8")
    has_alpha = picture.mode in ("LA", "PA", "RGBA") or "transparency" in picture.info
    if has_alpha:
        channels = np.asarray(picture.convert("RGBA"))
    elif picture.mode in ("1", "L"):
        channels = np.asarray(picture.convert("L"))[..., None]
    else:
        channels = np.asarray(picture.convert("RGB"))
    see_through = channels[..., 3] < BRIGHTEST if has_alpha else None
    counted = channels if with_alpha else channels[..., :3]
    return MapPicture(
        sums=counted.sum(axis=-1, dtype=np.uint16),
        brightest=BRIGHTEST * counted.shape[-1],
        see_through=see_through,
    )


__all__ = ["MAX_CELLS", "MapPicture", "read_map_picture"]
