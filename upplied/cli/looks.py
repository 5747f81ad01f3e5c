"""`upplied looks` and `findings looks`: every photo that shows a place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from upplied.cli.findings import app
from upplied.cli.options import FindingArgument, PointArgument, StructureArgument
from upplied.cli.terminal import Results, complain, complain_each, errors, point_text
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.findings.looks import Spot


@Parameter(name="*")
@dataclass(frozen=True)
class LookResults(Results):
    """The flights whose looks count, and the folder for crops of their photos."""

    out: Annotated[Path | None, Parameter(help="Folder for crops side by side, with a page.")] = None
    photos: Annotated[Path | None, Parameter(help="Folder of photos that were moved.")] = None
    simulated: Annotated[bool, Parameter(help="Include simulated flights.")] = False

    def show_looks(self, store: Catalog, title: str, spot: Spot) -> int:
        """Print the looks at a place and write the crops; 1 if a photo is missing."""
        from upplied.findings.looks import FLOWN, looks_at_spot, looks_frame

        with errors.status("casting rays"):
            looks = looks_at_spot(store, spot, (*FLOWN, *["simulated"] * self.simulated))
        frame = looks_frame(looks)
        sides = frame[["left_px", "top_px", "right_px", "bottom_px"]].round(0)
        frame["box"] = [" ".join(f"{side:.0f}" for side in row) for row in sides.to_numpy()]
        self.show_frame(f"views of {title}", frame, LABELS["looks"])
        if self.out is None:
            return 0
        from upplied.findings.crops import write_crops

        structure = store.structure(spot.structure_id)
        page, missing = write_crops(self.out, title, looks, spot, structure, self.photos)
        complain_each("missing", missing)
        self.say(page)
        return int(bool(missing))


LOOKED = LookResults()


@app.command(name="looks")
def looks_of(finding: FindingArgument, /, *, results: LookResults = LOOKED) -> int:
    """List every photo of every flight that shows a finding."""
    from upplied.findings.looks import off_surface, spot_of

    store = results.opened()
    row = store.finding(finding)
    spot = spot_of(row)
    sha256 = str(store.newest("structures", spot.structure_id)["sha256"])
    if spot.structure_sha256 != sha256:
        off = float(off_surface(store, [spot], sha256)[0])
        words = f"{spot.structure_id} has changed since the finding was placed"
        complain(f"{words}; the place is {off:.2f} m off its surface")
    return results.show_looks(store, f"finding {row['finding_id']}", spot)


def looks(
    structure: StructureArgument,
    point: PointArgument,
    /,
    *,
    size: Annotated[float, Parameter(help="Width of the area to show, in metres.")] = 0.5,
    results: LookResults = LOOKED,
) -> int:
    """List every photo of every flight that shows the place of the surface nearest to a point."""
    from upplied.findings.looks import spot_at

    store = results.opened()
    title = f"{point_text(point)} of {structure}"
    return results.show_looks(store, title, spot_at(store, structure, point, size / 2))
