"""Pictures in files, as levels of red, green and blue.

Pillow decodes files. Its conversions cut gray of 16 bits off at 255, and compare a transparent level of some files with
other levels than those of the pixels; so both are done here.
"""

import os.path
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mercator_design.config.schema import FieldError

MAX_PIXELS = 4_000_000
"""Pixels of a picture: a small file with more could fill the memory."""

_FORMATS = ("PNG", "JPEG", "BMP", "PPM")

_HIGHEST = {"1": 1, "L;2": 3, "L;4": 15}
"""The highest level of gray, by Pillow's name for the packing; Pillow scales the pixels to 255, but not the key."""


def read_picture(path: str) -> NDArray[np.uint8]:
    """The pixels of a picture (rows, columns, 3); with their opacity (rows, columns, 4) if it is not 255 everywhere.

    Raises:
        FieldError: "path": the file is not a picture, is damaged or too large, or has pixels that cannot be read.
    """
    from PIL import Image, ImageOps

    if not os.path.isfile(path):  # noqa: PTH113 - never raises; opening a pipe or device would block
        raise FieldError("path", f"no such file: {path}")
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path, formats=_FORMATS) as picture:
            _check(picture, path)
            packing = str(picture.tile[0][3]) if picture.tile else ""  # lost when the pixels are decoded
            shown = _decoded(ImageOps.exif_transpose(picture), packing)
    except FieldError:
        raise
    except Exception as error:  # noqa: BLE001 - a decoder may raise anything for a damaged file
        reason = str(error) or type(error).__name__
        raise FieldError("path", f"not a picture (PNG, JPEG, BMP or PPM) that can be read: {reason}") from None
    return np.ascontiguousarray(shown[..., :3] if (shown[..., 3:] == 255).all() else shown)


def painted_over(pixels: NDArray[np.uint8], background: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Pixels of `read_picture` over a background, which shows where they are transparent: (rows, columns, 3)."""
    if pixels.shape[2] == 3:
        return pixels
    opacity = pixels[..., 3:] / 255.0
    return np.rint(pixels[..., :3] * opacity + np.array(background) * (1.0 - opacity)).astype(np.uint8)


def _check(picture: Any, path: str) -> None:  # noqa: ANN401 - the type of Pillow, which is slow to import
    """Refuse a picture before its pixels are decoded."""
    width, height = picture.size
    if width * height > MAX_PIXELS:
        raise FieldError("path", f"expected at most {MAX_PIXELS} pixels, found {width} x {height} in {path}")
    if picture.format == "PNG" and picture.is_animated:  # the other pictures in a JPEG are views of the first
        raise FieldError("path", f"expected one picture, found an animation of {picture.n_frames} in {path}; save one")
    if picture.mode == "F":
        found = f"found floating-point numbers in {path}"
        raise FieldError("path", f"expected whole numbers of 8 or 16 bits, {found}; save it as PNG")


def _decoded(picture: Any, packing: str) -> NDArray[np.uint8]:  # noqa: ANN401 - as above
    """Red, green, blue and opacity (rows, columns, 4).

    Args:
        picture: The picture.
        packing: Pillow's name for the packing of its pixels in the file.
    """
    key = picture.info.get("transparency")  # of a PNG: the gray or colour that is transparent
    if picture.mode not in {"1", "L", "I", "I;16"}:
        if picture.mode == "RGB" and key is not None and "16" in packing:  # only the higher 8 bits are left to compare
            raise FieldError("path", "expected an alpha channel, found a transparent colour of 16 bits; save it with 8")
        return np.array(picture.convert("RGBA"))
    levels = np.array(picture.convert("L") if picture.mode == "1" else picture)
    if packing in _HIGHEST and key is not None:
        key = min(key, _HIGHEST[packing]) * 255 // _HIGHEST[packing]  # some versions of Pillow scale the key of one bit
    opacity = np.where(levels == key, 0, 255)
    gray = levels >> 8 if picture.mode.startswith("I") else levels  # as Pillow does with colours of 16 bits
    return np.stack([gray, gray, gray, opacity], axis=-1).astype(np.uint8)
