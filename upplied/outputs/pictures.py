"""Photos as pixels; files that are no pictures, or larger than any camera's, are refused."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.extras import extra
from upplied.outputs.draw.sheet import png

with extra("export"):
    from PIL import Image, ImageDraw

_THUMBNAIL_PX = 320


def size_of(data: bytes, what: str) -> tuple[int, int]:
    """Width and height of a photo, px."""
    with _opened(data, what) as picture:
        return int(picture.size[0]), int(picture.size[1])


def pixels_in(data: bytes, what: str) -> np.ndarray:
    """The pixels (H, W, 3) of a photo."""
    with _opened(data, what) as picture:
        return np.asarray(picture.convert("RGB"))


def marked(pixels: np.ndarray, corners: np.ndarray, half_px: float) -> bytes:
    """A PNG thumbnail of the picture around a mark (K, 2), px, with the mark outlined."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    low = np.clip(np.floor(middle - half_px), 0, None).astype(int)
    high = np.minimum(np.ceil(middle + half_px), pixels.shape[1::-1]).astype(int)
    with Image.fromarray(pixels[low[1] : high[1], low[0] : high[0]]) as picture:
        scale = _THUMBNAIL_PX / max(picture.size)
        shown = picture.resize([max(1, round(side * scale)) for side in picture.size])
    left, top, right, bottom = ((np.array([corners.min(axis=0), corners.max(axis=0)]) - low) * scale).ravel()
    ImageDraw.Draw(shown).rectangle(
        (left - 4, top - 4, right + 4, bottom + 4), outline=(214, 39, 40), width=2
    )
    return png(np.asarray(shown))


@contextmanager
def _opened(data: bytes, what: str) -> Iterator[Any]:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            yield picture
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(what, f"cannot be read: {error}"[:300], "a picture") from None
