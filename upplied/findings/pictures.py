"""Photos as pixels; what is no picture, or one beyond any camera, is told and not opened."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.extras import extra

with extra("export"):
    from PIL import Image


def size_of(data: bytes, what: str) -> tuple[int, int]:
    """Width and height of a photo, px."""
    with _opened(data, what) as picture:
        return int(picture.size[0]), int(picture.size[1])


def pixels_in(data: bytes, what: str) -> np.ndarray:
    """The pixels (H, W, 3) of a photo."""
    with _opened(data, what) as picture:
        return np.asarray(picture.convert("RGB"))


def png(pixels: np.ndarray) -> bytes:
    """Pixels (H, W, 3) as a PNG."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


@contextmanager
def _opened(data: bytes, what: str) -> Iterator[Any]:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            yield picture
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(what, f"cannot be read: {error}"[:300], "a picture") from None
