"""Crops of photos at a spot, warped by the surface into one view and scale, side by side on a page."""

import hashlib
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import binary_erosion, laplace, map_coordinates

from upplied.errors import InputError, UppliedError
from upplied.files import replace_file
from upplied.findings.looks import Look, Spot, plane_axes
from upplied.findings.photos import MOST_BYTES
from upplied.findings.rays import pixels_of
from upplied.geometry.scene import Scene, scene_of
from upplied.inputs.files import read_regular
from upplied.outputs.draw.sheet import png
from upplied.outputs.pictures import pixels_in
from upplied.records import Floats, Structure

_LEAST_PX, _MOST_PX = 64, 800  # of a crop's sides
_SHOWN_PX = 320  # of its width on the page, at least
_WIDER = 1.3  # than what is meant
_MOST = 200  # crops of a page

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
content="default-src 'none'; style-src 'unsafe-inline'; img-src 'self' file:">
<title>{title}</title>
<style>body{{font:15px sans-serif;margin:1em}}
figure{{display:inline-block;margin:0 1em 1em 0;vertical-align:top}}
figure,img{{width:{width}px}} figcaption{{font-size:13px}}</style></head>
<body><h1>{title}</h1><p>{about}</p>{body}</body></html>
"""


def write_crops(
    folder: Path, title: str, looks: Sequence[Look], spot: Spot, structure: Structure,
    photos: Path | None = None,
) -> tuple[Path, list[str]]:  # fmt: skip
    """Write the crops of looks that have a photo, and a page that shows them side by side.

    Photos that are not where they were are looked for in the folder `photos`. Returned are the page, and the
    photos that are missing or changed, in words.
    """
    shown = [look for look in looks if look.row["photo"]][:_MOST]
    finest = min((look.row["mm_px"] for look in shown), default=1.0)
    grid, wide_m = _grid(spot, scene_of(structure), finest)
    figures, missing = [], []
    folder.mkdir(parents=True, exist_ok=True)
    for number, look in enumerate(shown, 1):
        try:
            crop = _warped(_photo(look, photos), look, grid)
        except UppliedError as error:
            missing.append(str(error))
            continue
        name = f"look-{number:03}.png"
        replace_file(folder / name, png(crop))
        figures.append(_figure(name, look.row, sharpness(crop)))
    scale = 1e3 * wide_m / grid.shape[1]
    about = f"Each picture is {wide_m:.2f} m wide, {scale:.2f} mm a pixel, seen along the normal."
    body, width = "".join(figures) or "No photo.", max(grid.shape[1], _SHOWN_PX)
    title = html.escape(title[:1].upper() + title[1:])
    text = _PAGE.format(title=title, width=width, about=about, body=body)
    return replace_file(folder / "index.html", text), missing


def sharpness(crop: np.ndarray) -> float:
    """How sharp a crop is: the variance of its Laplacian over that of its grey values; higher is sharper."""
    grey = crop.astype(float).mean(axis=2)
    known = binary_erosion(crop.any(axis=2))  # not where the photo ends
    spread = float(grey[known].var()) if known.any() else 0.0
    return float(laplace(grey)[known].var() / spread) if spread > 0 else 0.0


def _grid(spot: Spot, scene: Scene, mm_px: float) -> tuple[Floats, float]:
    """Points (P, P, 3) of the surface about a spot, row by row from above, and how wide they reach, m."""
    right, up = plane_axes(spot.normal)
    offset = (spot.corners - spot.place) @ np.column_stack([right, up])
    half = _WIDER * float(np.abs(offset).max())
    count = int(np.clip(2e3 * half / max(mm_px, 1e-6), _LEAST_PX, _MOST_PX))
    steps = np.linspace(-half, half, count)
    x, y = np.meshgrid(steps, -steps)
    flat = (spot.place + x[..., None] * right + y[..., None] * up).reshape(-1, 3)
    reach = scene.cast(flat + half * spot.normal, np.broadcast_to(-spot.normal, flat.shape))[0]
    near = np.isfinite(reach) & (reach < 2 * half)
    flat[near] += (half - reach[near])[:, None] * spot.normal
    return flat.reshape(count, count, 3), 2 * half


def _photo(look: Look, folder: Path | None) -> np.ndarray:
    """The pixels (H, W, 3) of a photo at its path, else in a folder, if its bytes are the same."""
    row = look.row
    places = [Path(row["path"]), *([folder / row["photo"]] if folder is not None else [])]
    place = next((path for path in places if path.is_file()), None)
    what = f"photo {row['photo']}"
    if place is None:
        remedy = "name the folder where it is now: --photos FOLDER"
        raise InputError(what, f"is not at {row['path']}", "where it was registered", remedy)
    data = read_regular(place, MOST_BYTES)
    if hashlib.sha256(data).hexdigest() != row["sha256"]:
        raise InputError(what, f"at {place} is another file", "the registered file")
    return pixels_in(data, what)


def _warped(photo: np.ndarray, look: Look, grid: Floats) -> np.ndarray:
    """The photo's pixels at the points of a grid (P, P, 3); black where it does not reach."""
    pixels = pixels_of(look.camera, look.position, look.quat_xyzw, grid.reshape(-1, 3))
    # The middle of the first pixel is half a pixel from the corner.
    rows, columns = pixels[:, 1] - 0.5, pixels[:, 0] - 0.5
    at = np.nan_to_num(np.stack([rows, columns]), nan=-1e6)
    bands = [map_coordinates(photo[:, :, band], at, order=1, cval=0) for band in range(3)]
    return np.stack(bands, axis=1).reshape(*grid.shape[:2], 3).astype(np.uint8)


def _figure(name: str, row: dict[str, Any], sharp: float) -> str:
    when = "" if row["taken_at"] is None else f"{row['taken_at']:%Y-%m-%d %H:%M}"
    words = (
        f"{when} {row['photo']}: {row['mm_px']:.2f} mm/px, {row['distance_m']:.1f} m, "
        f"{row['incidence_deg']:.0f} degrees from the normal, sharpness {sharp:.2f}"
        f"{', doubtful by ' if row['doubt'] else ''}{row['doubt']}"
    )
    text = html.escape(words.strip())
    return f'<figure><img src="{name}" alt="{text}"><figcaption>{text}</figcaption></figure>'
