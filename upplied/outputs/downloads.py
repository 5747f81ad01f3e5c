"""The missions that a report folder holds: those of plans that a person released, as they pass the gate."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from upplied.catalog import Catalog
from upplied.errors import RefusedError
from upplied.outputs.missions import FORMATS
from upplied.outputs.render import export_transfer

#: What lies beside a transfer's page, and how it is called there; other formats by `upplied export`.
LABELS = {"qgc-plan": "QGroundControl", "kml": "KML", "mcap": "MCAP"}


def released(plans: Mapping[str, Mapping[str, Any]]) -> str:
    """The plan of a pair that may be flown, by its id; empty where nobody released one."""
    ids = [str(row["transfer_id"]) for row in plans.values() if row.get("state") == "released"]
    return ids[0] if ids else ""


def mission_file(catalog: Catalog, transfer_id: str, format: str) -> bytes:
    """A mission with the usual options, as the bytes of its file.

    Raises
    ------
    UppliedError
        If it does not pass the gate, or takes several sorties.
    """
    with tempfile.TemporaryDirectory() as folder:
        written = export_transfer(catalog, transfer_id, format, Path(folder, f"mission{FORMATS[format]}"))
        if len(written.paths) > 1:  # one of several would look like all of it
            raise RefusedError(
                f"the mission of {transfer_id}", f"takes {len(written.paths)} sorties", "one file here",
                f"upplied export {transfer_id} --to {format}",
            )  # fmt: skip
        return written.paths[0].read_bytes()
