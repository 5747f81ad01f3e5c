"""`upplied looks`: the photos that show a place of a structure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from upplied.cli.terminal import Results, complain, errors
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.findings.looks import Spot


@Parameter(name="*")
@dataclass(frozen=True)
class LookResults(Results):
    """The looks at a place: of which flights, and with crops of the photos where a folder is given."""

    out: Annotated[Path | None, Parameter(help="Folder for crops side by side, with a page.")] = None
    photos: Annotated[Path | None, Parameter(help="Folder of photos that were moved.")] = None
    simulated: Annotated[bool, Parameter(help="Include simulated flights.")] = False

    def show_looks(self, store: Catalog, title: str, spot: Spot) -> int:
        """Print the looks at a place, and write the crops; 1 where a photo is missing."""
        from upplied.findings.looks import FLOWN, looks_at_spot, looks_frame

        with errors.status("casting rays"):
            looks = looks_at_spot(store, spot, (*FLOWN, *["simulated"] * self.simulated))
        frame = looks_frame(looks)
        sides = frame[["left_px", "top_px", "right_px", "bottom_px"]].round(0)
        frame["box"] = [" ".join(f"{side:.0f}" for side in row) for row in sides.to_numpy()]
        self.show_frame(f"looks at {title}", frame, LABELS["looks"])
        if self.out is None:
            return 0
        from upplied.findings.crops import write_crops

        structure = store.structure(spot.structure_id)
        page, missing = write_crops(self.out, title, looks, spot, structure, self.photos)
        for reason in missing:
            complain(f"missing: {reason}")
        self.say(page)
        return int(bool(missing))


LOOKED = LookResults()


def looks(
    structure: str,
    x: float,
    y: float,
    z: float,
    /,
    *,
    size: Annotated[float, Parameter(help="Width of the area to show, m.")] = 0.5,
    results: LookResults = LOOKED,
) -> int:
    """List every photo of every flight that shows the place of the surface nearest to a point.

    Parameters
    ----------
    x, y, z : float
        Point in the frame of the structure, m.
    """
    from upplied.findings.looks import spot_at

    store = results.opened()
    title = f"({x:g}, {y:g}, {z:g}) m of {structure}"
    return results.show_looks(store, title, spot_at(store, structure, (x, y, z), size / 2))
