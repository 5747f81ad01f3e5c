"""`upplied looks`: the photos that show a place of a structure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption, JsonOption
from upplied.cli.terminal import complain, errors, opened, say, show_frame

looking = App(name="looks", help="List every photo that shows a place of a structure.")

LOOKS = {
    "flight_id": "flight", "kind": "kind", "taken_at": "taken", "photo": "photo", "t_s": "s",
    "distance_m": "m", "mm_px": "mm/px", "incidence_deg": "incidence deg", "blur_px": "blur px",
    "in_picture_pct": "in picture %", "box": "box px",
}  # fmt: skip
OutOption = Annotated[
    Path | None, Parameter(name="--out", help="Folder for crops side by side, with a page.")
]
PhotosOption = Annotated[Path | None, Parameter(name="--photos", help="Folder of photos that were moved.")]


@looking.default
def looks_at(
    structure: str,
    x: float,
    y: float,
    z: float,
    /,
    *,
    size: Annotated[float, Parameter(help="Width of the area to show, m.")] = 0.5,
    out: OutOption = None,
    photos: PhotosOption = None,
    simulated: Annotated[bool, Parameter(help="Simulated flights as well.")] = False,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """List every photo of every flight that shows the place of the surface nearest to a point.

    Parameters
    ----------
    x, y, z : float
        Point in the frame of the structure, m.
    """
    from upplied.findings.looks import spot_at

    store = opened(catalog)
    title = f"({x:g}, {y:g}, {z:g}) m of {structure}"
    return show_looks(
        store, title, spot_at(store, structure, (x, y, z), size / 2), out, photos, simulated, json
    )


def show_looks(store: Any, title: str, spot: Any, out: Any, photos: Any, simulated: bool, json: bool) -> int:
    """Print the looks at a place, and write crops of them where a folder is given."""
    from upplied.findings.looks import looks_at_spot, looks_frame

    with errors.status("casting rays"):
        looks = looks_at_spot(store, spot, simulated)
    frame = looks_frame(looks)
    sides = frame[["left_px", "top_px", "right_px", "bottom_px"]].round(0)
    frame["box"] = [" ".join(f"{side:.0f}" for side in row) for row in sides.to_numpy()]
    show_frame(f"looks at {title}", frame, LOOKS, json)
    if out is None:
        return 0
    from upplied.findings.crops import write_crops

    page, missing = write_crops(out, title, looks, spot, store.structure(spot.structure_id), photos)
    for reason in missing:
        complain(f"missing: {reason}")
    if not json:
        say(page)
    return int(bool(missing))
