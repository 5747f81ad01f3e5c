"""Photos as pixels, and crops of those of findings; files that are no pictures, or too large, are refused."""

import hashlib
import io
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.errors import InputError, UppliedError
from upplied.extras import extra
from upplied.inputs.files import read_regular
from upplied.outputs.draw.sheet import png

with extra("export"):
    from PIL import Image, ImageDraw

_THUMBNAIL_PX = 320
_MOST, _MOST_BYTES = 24, 200 << 20
_NAMED = re.compile(r"finding ([0-9a-f]{1,64}): from ")
_WIDER, _LEAST = 3.0, 0.08  # of the mark, and of the photo's width, that a thumbnail shows at least


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
    box = (np.array([corners.min(axis=0), corners.max(axis=0)]) - low) * scale + [[-4], [4]]
    ImageDraw.Draw(shown).rectangle(box.ravel().tolist(), outline=(214, 39, 40), width=2)
    return png(np.asarray(shown))


@contextmanager
def _opened(data: bytes, what: str) -> Iterator[Any]:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            yield picture
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(what, f"cannot be read: {error}"[:300], "a picture") from None


def reference_photos(catalog: Catalog, warnings: Sequence[str]) -> list[tuple[str, bytes]]:
    """A caption and a PNG of each finding that a plan's warnings name; no bytes without a photo.

    Photos that are gone, changed or unreadable are named with the reason.
    """
    names = [match[1] for text in warnings if (match := _NAMED.match(text))][:_MOST]
    if not names:
        return []
    rows = {str(row["finding_id"]): row for row in catalog.findings().to_dict("records")}
    return [_reference(rows[name]) for name in names if name in rows]


def _reference(row: dict[Any, Any]) -> tuple[str, bytes]:
    about = " ".join(filter(None, (f"Finding {row['finding_id']}", row["severity"], row["class"])))
    if not row["photo"]:
        return f"{about}: no photo", b""
    try:
        data = read_regular(Path(row["photo_path"]), _MOST_BYTES)
        if hashlib.sha256(data).hexdigest() != row["photo_sha256"]:
            return f"{about}: photo {row['photo']} is not the one that was registered", b""
        pixels = pixels_in(data, f"photo {row['photo']}")
    except UppliedError as error:
        return f"{about}: {error}", b""
    corners = np.array(json.loads(row["pixels_json"]), float).reshape(-1, 2)
    corners *= pixels.shape[1] / max(float(row["width_px"]), 1.0)
    half = max(_WIDER * float(np.ptp(corners, axis=0).max()), _LEAST * pixels.shape[1]) / 2
    return f"{about}: {row['photo']}, {row['distance_m']:.1f} m away", marked(pixels, corners, half)
