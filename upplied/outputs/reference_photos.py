"""Marked crops of the photos of findings, for the brief of a re-inspection."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.errors import UppliedError
from upplied.inputs.files import read_regular

_MOST, _MOST_BYTES = 24, 200 << 20
_NAMED = re.compile(r"finding ([0-9a-f]{1,64}): from ")
_WIDER, _LEAST = 3.0, 0.08  # of the mark, and of the photo's width, that a thumbnail shows at least


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
        from upplied.outputs.pictures import marked, pixels_in

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
