"""The health of a mesh file, in words: what it is, what was repaired, what a person should look at."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from upplied.geometry.reconstruction import held
from upplied.geometry.scene import surface_error_m
from upplied.inputs.concerns import Findings
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifest_keys import UNITS
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import normalise
from upplied.inputs.raw import RawMesh
from upplied.records import Record, Structure

_FORWARD = {"x": "y", "y": "z", "z": "x"}  # for each up axis; glTF has Y up and +Z forward


@dataclass(frozen=True, eq=False, repr=False)
class HealthReport(Record):
    """What `upplied structures check` says about a file."""

    path: Path
    format: str
    structure: Structure  # as it would be ingested
    size_m: tuple[float, float, float]  # along x (length), y (width), z (height)
    findings: Findings

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should look at."""
        return self.findings.warnings

    @property
    def problems(self) -> tuple[str, ...]:
        """Why it would be refused; empty where it would not."""
        return tuple(f"{verdict}. {verdict.remedy}" for verdict in self.findings.problems)

    @property
    def text(self) -> str:
        """The report for people, a fact a line."""
        facts = [*self._facts(), *(("note", what) for what in self.warnings)]
        facts += [("refused", what) for what in self.problems]
        head = f"{self.path.name} ({self.format.upper()})"
        return "\n".join([head, *(f"  {label:<11} {fact}" for label, fact in facts)])

    def _facts(self) -> Iterator[tuple[str, str]]:
        findings, mesh = self.findings, self.structure
        names = {metres: name for name, metres in UNITS.items()}
        unit = names.get(findings.unit_m, f"{findings.unit_m:g} m")
        yield "size", " x ".join(f"{side:.2f}" for side in self.size_m) + " m (length x width x height)"
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        yield "box", "  ".join(f"{a} {low[i]:.2f} to {high[i]:.2f}" for i, a in enumerate("xyz"))
        yield "units", f"{unit} ({findings.unit_from}); up {findings.up}, forward {findings.forward}"
        if (edges := findings.topology) is None:
            yield "cloud", f"{len(mesh.vertices)} points"
        else:
            parts = f"{findings.parts} connected part{'s' if findings.parts != 1 else ''}"
            parts += f", {findings.hidden_parts} hidden inside" if findings.hidden_parts else ""
            yield "mesh", f"{len(mesh.triangles)} triangles, {len(mesh.vertices)} vertices, {parts}"
            seen = f"{findings.outside_area_m2:.1f} m² visible from outside"
            share = 100 * findings.outside_area_m2 / max(findings.area_m2, 1e-12)
            yield "surface", f"{findings.area_m2:.1f} m², {seen} ({share:.0f} %)"
            count = f"{edges.boundary_edges} open edges, {edges.nonmanifold_edges} with over two faces"
            yield "watertight", "yes" if edges.watertight else f"no: {count}"
        yield "accuracy", _known(mesh)
        yield "repaired", "; ".join(findings.repairs) or "nothing"


def health_report(entry_or_path: StructureEntry | Path | str) -> HealthReport:
    """What a mesh or cloud file holds, what was repaired, and what a person should look at.

    For a path alone, units and axes are as the file declares, else assumed, and the report says so. An
    `InputError` where the file cannot be read at all; a size off the nominal one is reported, not raised.
    """
    declared = entry_or_path if isinstance(entry_or_path, StructureEntry) else None
    path = declared.path if declared else Path(str(entry_or_path))
    raw, sha256 = read_raw(path)
    entry, assumed = (declared, ()) if declared else _assumed(path, raw)
    structure, findings = normalise(entry, raw, sha256)
    if assumed:
        where = "file" if raw.unit_m is not None else "assumed"
        findings = replace(findings, unit_from=where, assumed=assumed)
    size, suffix = np.ptp(structure.vertices, axis=0).tolist(), entry.path.suffix.lower().removeprefix(".")
    return HealthReport(entry.path, suffix, structure, tuple(size), findings)


def _assumed(path: Path, raw: RawMesh) -> tuple[StructureEntry, tuple[str, ...]]:
    """An entry for a file that no manifest declares, and what was assumed, in words."""
    up, unit = raw.up or "z", "the file declares no unit: metres assumed; declare `units` in the manifest"
    axis = f"{up} is up (stated in the file)" if raw.up else f"{up} up assumed"
    axes = f"{axis}, {_FORWARD[up]} forward assumed; declare `up` and `forward` in the manifest"
    if raw.unit_m is not None:
        return StructureEntry("unnamed", "unknown", path, raw.unit_m, up, _FORWARD[up]), (axes,)
    return StructureEntry("unnamed", "unknown", path, 1.0, up, _FORWARD[up]), (unit, axes)


def _known(structure: Structure) -> str:
    error_m = surface_error_m(structure)
    if structure.surface_error_m is not None:
        return f"{error_m:.2f} m, declared" + " for a scan" * structure.is_scan
    if structure.surface == "drawn":
        return "exact (declared as drawn)"
    if not structure.is_scan:
        return f'{1000 * error_m:.1f} mm, by the roughness of a drawn mesh; if scanned: surface = "scanned"'
    known = f"{error_m:.2f} m, inferred for a scan"
    if len(structure.triangles):
        thin = f"objects thinner than {held(structure).thin_m:.2f} m"
        known += f"; {thin} may be missing: antennas, masts, cables"
    return f"{known} (declare surface_error_m if you know it)"
