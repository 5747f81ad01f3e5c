"""The columns of `transfers` that say what of the inspected surface a plan shows, and how."""

from __future__ import annotations

from upplied.catalog.schema.columns import REAL, Column

MEASURES = (
    Column(
        "coverage_inspected_pct",
        REAL,
        "%",
        "of what the demonstration was about, by weight, the share shown at least as well",
        low=0,
        high=100,
    ),
    Column(
        "inspected_without_counterpart_pct",
        REAL,
        "%",
        "of what the demonstration was about, what has no counterpart and so counts as not shown",
        low=0,
        high=100,
    ),
    Column(
        "inspected_unattainable_pct",
        REAL,
        "%",
        "of what the demonstration was about, what no safe camera could show",
        low=0,
        high=100,
    ),
)
