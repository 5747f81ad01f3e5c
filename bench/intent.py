"""Inspected coverage of every row, ours beside box scaling and the paper's way, the worst rows named.

    python bench/intent.py [--real] [--remeshed] [--only WORD] [--forced]

The fifteen transfers of the paper's tables on the samples, with ``--real`` on the real structures (see
bench/real_data.py), with ``--remeshed`` on the samples cut into other triangles. `able` is the most of the
inspected surface that a safe camera could show from as near as is asked: 100 less what is unattainable and
what has no counterpart. ``--forced`` plans what the gate refuses, too.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from transfers import Transfer, transfers

from upplied.config import settings_for
from upplied.geometry.scene import open3d
from upplied.planning.plan import plan_transfer
from upplied.records import Measures, Plan, Structure

_COLUMNS = (
    ("insp", "coverage_inspected_pct", 1),
    ("cp-", "inspected_without_counterpart_pct", 1),
    ("un-", "inspected_unattainable_pct", 1),
    ("tgt", "coverage_of_target_pct", 1),
    ("ctx", "coverage_context_pct", 1),
    ("seen", "coverage_seen_pct", 1),
    ("res50", "fidelity_resolution_p50", 2),
    ("res05", "fidelity_resolution_p05", 2),
    ("inc", "fidelity_incidence_deg_p95", 0),
    ("looks", "fidelity_looks_kept_pct", 0),
    ("dwell", "fidelity_dwell_kept_pct", 0),
    ("order", "fidelity_order", 2),
    ("turn", "camera_turn_ratio", 1),
    ("bend", "path_turn_ratio", 1),
    ("pan", "pan_fast_pct", 0),
    ("gsd", "gsd_mm_p50", 1),
    ("gsd0", "gsd_demonstrated_mm_p50", 1),
    ("fine", "gsd_within_pct", 1),
    ("blur", "blur_px_p99", 2),
    ("fre", "frechet_z", 2),
    ("fre_f", "frechet_floored", 2),
)


@dataclass(frozen=True)
class Row:
    """One transfer, planned three ways."""

    title: str
    plans: dict[str, Plan]

    def share(self, preset: str) -> float:
        """Inspected coverage over what is attainable, percent."""
        measures = self.plans[preset].measures
        return 100 * measures.coverage_inspected_pct / able(measures)


def able(measures: Measures) -> float:
    """The most of the inspected surface that could be shown, percent."""
    return 100 - measures.inspected_without_counterpart_pct - measures.inspected_unattainable_pct


def remeshed(structure: Structure) -> Structure:
    """The same surface in other triangles: each split in four, then simplified to as many as before."""
    mesh = open3d().geometry.TriangleMesh(
        open3d().utility.Vector3dVector(structure.vertices),
        open3d().utility.Vector3iVector(structure.triangles.astype(np.int32)),
    )
    mesh = mesh.subdivide_midpoint(1).simplify_quadric_decimation(len(structure.triangles))
    return replace(
        structure,
        vertices=np.asarray(mesh.vertices),
        triangles=np.asarray(mesh.triangles).astype(np.int64),
        sha256=structure.sha256 and f"{structure.sha256}-remeshed",
    )


def chosen(options: argparse.Namespace) -> Iterator[Transfer]:
    """The transfers that the options ask for."""
    yield from transfers(False, options.only)
    if options.remeshed:
        for row in transfers(False, options.only):
            title = replace(row.published, title=f"remeshed {row.published.title}")
            yield replace(row, published=title, target=remeshed(row.target))
    if options.real:
        for row in transfers(True, options.only):
            yield replace(row, published=replace(row.published, title=f"real {row.published.title}"))


def planned(transfer: Transfer, preset: str, forced: bool) -> Plan:
    """The plan of one preset."""
    settings = settings_for(preset)
    if forced and settings.registration.acceptance is not None:
        settings = settings_for(preset, registration={"acceptance": None, "gamma": 1e9})
    return plan_transfer(transfer.demonstration, transfer.source, transfer.target, settings)


def main() -> None:
    """Print all rows, then the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--remeshed", action="store_true")
    parser.add_argument("--forced", action="store_true")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    print(f"{'transfer':36} {'preset':11}" + "".join(f"{name:>6}" for name, _, _ in _COLUMNS) + "  CPU s")
    rows = []
    for transfer in chosen(options):
        plans = {}
        for preset in ("recommended", "paper", "baseline"):
            began = time.process_time()
            plan = plans[preset] = planned(transfer, preset, options.forced)
            seconds = time.process_time() - began
            cells = "".join(f"{getattr(plan.measures, column):6.{digits}f}" for _, column, digits in _COLUMNS)
            title = transfer.published.title if preset == "recommended" else ""
            reason = f"  refused: {plan.reason[:90]}" if plan.status != "ok" else ""
            print(f"{title:36} {preset:11}{cells}{seconds:7.1f}{reason}", flush=True)
        rows.append(Row(transfer.published.title, plans))
    _print_summary(rows)


def _print_summary(rows: list[Row]) -> None:
    flown = [row for row in rows if row.plans["recommended"].status == "ok"]
    print(f"\n{len(flown)} of {len(rows)} rows accepted")
    ours = np.array([row.share("recommended") for row in flown])
    print(f"inspected coverage of attainable: mean {np.nanmean(ours):.1f}, worst {np.nanmin(ours):.1f}")
    for preset in ("paper", "baseline"):
        theirs = np.array([row.share(preset) for row in flown])
        print(f"    {preset}: mean {np.nanmean(theirs):.1f}, rows above ours "
              f"{int(np.nansum(theirs > ours))}")  # fmt: skip
    for word in ("engine", "wings", "hull", "fuselage", "tower", "piers", "sides"):
        some = [row for row in flown if word in row.title]
        if some:
            gain = [
                row.plans["recommended"].measures.coverage_inspected_pct
                - row.plans["baseline"].measures.coverage_inspected_pct
                for row in some
            ]
            print(f"    {word}: {np.nanmean(gain):+.1f} points on box scaling in the mean, "
                  f"{np.nanmin(gain):+.1f} at worst")  # fmt: skip
    print("worst rows: " + "; ".join(f"{flown[k].title} {ours[k]:.1f}" for k in np.argsort(ours)[:5]))


if __name__ == "__main__":
    main()
