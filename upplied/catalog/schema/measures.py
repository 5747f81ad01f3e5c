"""The columns of `transfers` that say what of the inspected surface a plan shows, and how."""

from __future__ import annotations

from upplied.catalog.schema.columns import REAL, TEXT, Column


def _share(name: str, meaning: str) -> Column:
    return Column(name, REAL, "%", meaning, low=0, high=100)


def _positive(name: str, unit: str, meaning: str) -> Column:
    return Column(name, REAL, unit, meaning, low=0)


MEASURES = (
    Column(
        "acceptance_probability",
        REAL,
        "1",
        "forecast, before planning, that most of what was inspected can be shown",
        low=0,
        high=1,
    ),
    Column(
        "counterpart_probability",
        REAL,
        "1",
        "that the parts flown to are those that correspond to the inspected ones; the least certain of them",
        low=0,
        high=1,
    ),
    Column("acceptance_evidence", TEXT, "", "what speaks for and against it, in words"),
    _share(
        "coverage_inspected_pct",
        "of what the demonstration was about, the share shown at least as finely: no coarser than 1.1 times "
        "its millimetres a pixel, or those that are asked for",
    ),
    _share(
        "coverage_inspected_scaled_pct",
        "the same relative to size: from as near as the demonstration times the scale of the structure",
    ),
    _share(
        "inspected_without_counterpart_pct", "of that, what has no counterpart and so counts as not shown"
    ),
    _share("inspected_unattainable_pct", "of that, what no safe camera could show as well"),
    _share("coverage_of_target_pct", "of the target's surface corresponding to it, the share shown as well"),
    _share("coverage_context_pct", "of what else the demonstration saw, the share that is seen"),
    _positive(
        "fidelity_resolution_p50", "1", "demonstrated millimetres a pixel over the plan's, by patch, median"
    ),
    _positive("fidelity_resolution_p05", "1", "the same, 5th percentile; 0 where there is no sharp look"),
    Column(
        "fidelity_incidence_deg_p95", REAL, "deg", "how much more obliquely patches are seen, 95th percentile"
    ),
    _share("fidelity_looks_kept_pct", "of the directions from which patches were looked at, the share kept"),
    _share("fidelity_dwell_kept_pct", "of the time for which patches were looked at, the share kept"),
    Column("fidelity_order", REAL, "1", "Kendall's tau of the moments of the looks", low=-1, high=1),
    _positive("camera_turn_ratio", "1", "turning of the camera over the demonstration's"),
    _share(
        "pan_fast_pct", "of the flight time, the share with the camera turning too fast for a sharp picture"
    ),
    _positive("path_turn_ratio", "1", "turning of the path over the demonstration's"),
    Column("standoff_mode", TEXT, "", "how near patches are to be shown: scaled, kept, or a ground sample"),
    _positive(
        "gsd_mm_p50",
        "mm",
        "ground sample distance: longer side of what a pixel covers of a patch, in the finest sharp look; "
        "median over patches",
    ),
    _positive("gsd_mm_p95", "mm", "the same, 95th percentile"),
    _positive("gsd_demonstrated_mm_p50", "mm", "the same of the demonstration, median"),
    _positive("gsd_demonstrated_mm_p95", "mm", "the same of the demonstration, 95th percentile"),
    _share(
        "gsd_within_pct",
        "of the inspected surface that a safe camera can show so, what is no coarser than 1.1 times the "
        "demonstrated ground sample distance, in mm, whatever the size of the target",
    ),
    _positive("blur_px_p50", "px", "motion in that look during the exposure, median over patches"),
    _positive("blur_px_p99", "px", "the same, 99th percentile"),
    _positive("defocus_px_p95", "px", "blur of what is out of focus in that look, 95th percentile"),
    _positive("frechet_floored", "1", "frechet_z with no axis divided by less than a tenth of the largest"),
    _positive("frechet_whole_z", "1", "frechet_z of the whole path, with the passes that were added"),
    _positive("added_s", "s", "time of the passes that were added, and of the ways to them"),
)

#: What of a target is known from a scan alone, and not known.
OF_SCANS = (
    _positive(
        "surface_error_m",
        "m",
        "how far a target's surface may lie from where it is taken to be, farther where a scan is thin; "
        "0 where it is declared drawn",
    ),
    _positive(
        "never_scanned_m2",
        "m2",
        "surface of the target where its scan is open, as the source tells: the path keeps clear of it",
    ),
)
