"""The tables of the catalog, each column declared once: name, type, unit, meaning, constraint.

The stored tables, the published Parquet, the checks of `verify` and the data dictionary
``catalog/README.md`` all follow from here. `dictionary` writes it.

Columns may be added, and older catalogs then read as missing values; how older programs fare, and when the
schema version is raised, is told in `upplied.catalog.schema.migrations`.
"""

from __future__ import annotations

from dataclasses import fields

from upplied.catalog.schema.columns import ADDED as _ADDED
from upplied.catalog.schema.columns import COMMIT as _COMMIT
from upplied.catalog.schema.columns import COMMIT_VERSION as _COMMIT_VERSION
from upplied.catalog.schema.columns import MOMENT, REAL, TEXT, TRUTH, WHOLE, Column, Table, committed
from upplied.catalog.schema.columns import ROW_SHA256 as _ROW_SHA256
from upplied.catalog.schema.columns import identity as _id
from upplied.catalog.schema.decided import DECIDED, DECISIONS, OVERRULED
from upplied.catalog.schema.edited import EDITS
from upplied.catalog.schema.flown import AS_FLOWN
from upplied.catalog.schema.measures import MEASURES, OF_SCANS
from upplied.catalog.schema.paths import POSES, WAYPOINTS
from upplied.catalog.schema.required import REQUIREMENTS
from upplied.catalog.schema.settled import SETTINGS
from upplied.config import PRESETS
from upplied.records import Measures

_OVERRULED = Column("overruled", TEXT, "", "rules that it breaks and a person overruled, by name")


def _version_of(whole: str) -> tuple[Column, ...]:
    """How a version of a structure or demonstration came, and whether it went."""
    return (
        Column("retired", TRUTH, "", f"taken out of {whole} with this version; history stays"),
        Column("version", WHOLE, "1", "1, 2, ... per id in the order of commits, counted when read", low=1),
        Column("added_at", MOMENT, "UTC", f"when this version was added, {_ADDED}", required=True),
        _COMMIT,
        _COMMIT_VERSION,
        _ROW_SHA256,
    )


STRUCTURES = Table(
    "structures",
    "one row per structure and version; the newest of an id is current",
    ("structure_id", "version"),
    (
        _id("structure_id", "name of the structure"),
        _id("kind", "what it is: structures of one kind correspond to each other"),
        Column("site", TEXT, "", "where it stands, in words"),
        Column("notes", TEXT, "", "free text from the manifest"),
        Column("sha256", TEXT, "", "hash of the bytes of its file and of what the manifest says of it"),
        _id("mesh_sha256", "hash of the stored mesh, which is meshes/<hash>.parquet"),
        Column("n_vertices", WHOLE, "1", "vertices, or points of a point cloud", required=True, low=1),
        Column("n_triangles", WHOLE, "1", "triangles; 0 for a point cloud", required=True, low=0),
        Column("size_x_m", REAL, "m", "extent along +X (forward)", low=0),
        Column("size_y_m", REAL, "m", "extent along +Y", low=0),
        Column("size_z_m", REAL, "m", "extent along +Z (up)", low=0),
        Column("diagonal_m", REAL, "m", "diagonal of the bounding box", low=0),
        Column(
            "lat_deg", REAL, "deg", "WGS 84 latitude of the origin; missing where unplaced", low=-90, high=90
        ),
        Column("lon_deg", REAL, "deg", "WGS 84 longitude of the origin", low=-180, high=360),
        Column("alt_m", REAL, "m", "altitude of the origin above the datum"),
        Column("heading_deg", REAL, "deg", "bearing of +X, clockwise from true north"),
        Column("datum", TEXT, "", "of alt_m: ellipsoid (WGS 84) or amsl", allowed=("", "ellipsoid", "amsl")),
        Column("surroundings_json", TEXT, "", "ground, keep-out boxes, geofence and ceiling, m"),
        Column("landmarks_json", TEXT, "", "named points, m, structure frame"),
        Column("symmetric", TRUTH, "", "declared: no heading can be told from the shape"),
        Column(
            "surface",
            TEXT,
            "",
            "declared: drawn or scanned; empty: a cloud is scanned, a mesh drawn",
            allowed=("", "drawn", "scanned"),
        ),
        Column(
            "surface_error_m",
            REAL,
            "m",
            "stated: how far its surface may lie from where the file has it; null: measured",
            low=0,
        ),
        Column("tells_parts", TRUTH, "", "its pieces are parts, as those of a scan are not; null: not asked"),
        Column("findings", TEXT, "", "the rules it breaks, and those overruled, in words"),
        Column("verdicts_json", TEXT, "", "the same with what was found, allowed and to be done"),
        _OVERRULED,
        *_version_of("the fleet"),
    ),
    ("structure_id", "added_at"),
)

DEMONSTRATIONS = Table(
    "demonstrations",
    "one row per demonstration and version; the newest of an id is current",
    ("demonstration_id", "version"),
    (
        _id("demonstration_id", "name of the demonstration"),
        _id("structure_id", "the structure it was flown on"),
        Column("operator", TEXT, "", "who flew"),
        Column("site", TEXT, "", "where, in words"),
        Column("notes", TEXT, "", "free text, and what salvage lost"),
        Column("about", TEXT, "", "what the user says it inspected: parts and boxes; empty: inferred"),
        Column("sha256", TEXT, "", "hash of the bytes of the log and of what its side-car and options say"),
        _id("poses_sha256", "hash of the stored poses"),
        Column("n_poses", WHOLE, "1", "rows in `poses`", required=True, low=1),
        Column("duration_s", REAL, "s", "from the first to the last pose", low=0),
        Column("path_length_m", REAL, "m", "length of the flown path, breaks left out", low=0),
        Column("hfov_deg", REAL, "deg", "camera: full horizontal field of view", low=0, high=360),
        Column("vfov_deg", REAL, "deg", "camera: full vertical field of view", low=0, high=180),
        Column("min_range_m", REAL, "m", "camera: nearest useful distance", low=0),
        Column("max_range_m", REAL, "m", "camera: farthest useful distance", low=0),
        Column("width_px", WHOLE, "px", "camera: image width; 0 where not known", low=0),
        Column("height_px", WHOLE, "px", "camera: image height; 0 where not known", low=0),
        Column("model", TEXT, "", "camera: its name in `cameras.toml`; empty where not known"),
        Column("exposure_s", REAL, "s", "camera: exposure of one picture; null where not known", low=0),
        Column("trigger_s", REAL, "s", "camera: least time between two photos; null where not known", low=0),
        Column("focus_m", REAL, "m", "camera: nearest distance in focus; null where not known", low=0),
        Column("focal_mm", REAL, "mm", "camera: focal length; null where not known", low=0),
        Column("f_number", REAL, "1", "camera: aperture; null where not known", low=0),
        Column("stills", TRUTH, "", "photos, a pose each; null or false: a film"),
        Column("clock", TEXT, "", "which stamp of the log was used"),
        Column("topic", TEXT, "", "which topic of the log was used"),
        Column("breaks_json", TEXT, "", "first pose after each gap"),
        Column("dropped_json", TEXT, "", "samples dropped, by reason"),
        Column("degraded", TRUTH, "", "the log was salvaged; the notes say what was lost"),
        Column(
            "verdict",
            TEXT,
            "",
            "of the rules for flights; empty where it was not judged",
            allowed=("", "good", "warned", "overruled"),
        ),
        Column("findings", TEXT, "", "the rules it breaks, in words"),
        _OVERRULED,
        Column("lowest_m", REAL, "m", "lowest height over the ground, or over the structure's lowest point"),
        Column("flown_clearance_m", REAL, "m", "least distance of the flown path from the structure", low=0),
        Column("inside_pct", REAL, "%", "of the poses, inside the structure", low=0, high=100),
        Column("axis_pct", REAL, "%", "of the poses, the axis meeting the structure", low=0, high=100),
        Column("shown_pct", REAL, "%", "of the pictures, showing the structure in range", low=0, high=100),
        Column("fit_pct", REAL, "%", "of the poses that an inspection could hold", low=0, high=100),
        Column("speed_p99_mps", REAL, "m/s", "speed that 99 % of the flight keep", low=0),
        Column("recorded_pct", REAL, "%", "of the time that was recorded", low=0, high=100),
        Column("longest_gap_s", REAL, "s", "longest silence of the log", low=0),
        Column("hover_s", REAL, "s", "standing still for longer than the cap, in all", low=0),
        Column("passport_json", TEXT, "", "all that was measured and judged, with the bounds"),
        *_version_of("use"),
    ),
    ("demonstration_id", "added_at"),
)


TRANSFERS = Table(
    "transfers",
    "one row per plan, refused and failed ones too; the newest of a pair, preset and purpose is current",
    ("transfer_id",),
    (
        _id("transfer_id", "name of the plan: the first digits of `key`"),
        _id("demonstration_id", "the demonstration that was transferred"),
        _id("source_id", "the structure it was flown on"),
        _id("target_id", "the structure it was transferred to"),
        Column("kind", TEXT, "", "kind of the target"),
        Column("preset", TEXT, "", "which method", required=True, allowed=PRESETS),
        Column("status", TEXT, "", "what came of it", required=True, allowed=("ok", "refused", "failed")),
        Column("reason", TEXT, "", "why it is not ok, in words"),
        Column("flyable", TRUTH, "", "whether it may be flown as it is; plans for comparison often may not"),
        Column("not_flyable", TEXT, "", "why it may not, in words"),
        *MEASURES,
        Column("coverage_paper_pct", REAL, "%", "the paper's measure: target points in any frustum", low=0),
        Column(
            "coverage_seen_pct",
            REAL,
            "%",
            "surface seen in the demonstration that is really seen",
            low=0,
            high=100,
        ),
        Column(
            "coverage_attainable_pct", REAL, "%", "the most that any safe camera could see", low=0, high=100
        ),
        Column("frechet_z", REAL, "1", "continuous Frechet distance to the demonstration, z-scored", low=0),
        Column("frechet_m", REAL, "m", "the same in metres, after alignment", low=0),
        Column(
            "min_clearance_m",
            REAL,
            "m",
            "least distance of the whole path to the target's surface, less what that may be off",
        ),
        *OF_SCANS,
        Column("path_length_m", REAL, "m", "length of the planned path", low=0),
        Column("duration_s", REAL, "s", "from the first to the last waypoint", low=0),
        Column("standoff_ratio_p50", REAL, "1", "median of planned over demonstrated stand-off", low=0),
        Column(
            "standoff_kept_pct",
            REAL,
            "%",
            "viewpoints from which their counterparts are seen within 20 % of the wanted stand-off",
            low=0,
            high=100,
        ),
        Column(
            "incidence_p95_deg",
            REAL,
            "deg",
            "95th percentile of the incidence on seen surface",
            low=0,
            high=90,
        ),
        Column("peak_speed_mps", REAL, "m/s", "highest speed", low=0),
        Column("peak_acceleration_mps2", REAL, "m/s2", "highest acceleration", low=0),
        Column("n_viewpoints", WHOLE, "1", "waypoints that are viewpoints", required=True, low=0),
        Column("n_waypoints", WHOLE, "1", "rows in `waypoints`", required=True, low=0),
        Column("icp_score_m2", REAL, "m2", "mean squared nearest-neighbour distance after alignment", low=0),
        Column("acceptance", REAL, "1", "how badly the structures fit, free of scale and density", low=0),
        Column("runner_up_gap", REAL, "1", "relative gap to the next best orientation"),
        Column("counterpart_summary", TEXT, "", "parts matched, and parts without a counterpart"),
        Column("parts_told_by", TEXT, "", "structure that told the parts of a scan; empty: none did"),
        Column("siblings", TEXT, "", "JSON list, id and hash of each structure that was asked for parts"),
        Column(
            "counterparts",
            TEXT,
            "",
            "JSON list, per inspected part: how many like it, which flown to, left out and why, doubt",
        ),
        Column("warnings", TEXT, "", "JSON list of what a pilot should know"),
        Column("planned_at", MOMENT, "UTC", "when it was planned, by the planner's clock", required=True),
        Column("run_id", TEXT, "", "the run that planned it"),
        Column(
            "planned_on",
            TEXT,
            "",
            "where it was planned: host/process/engine, and after a colon the engine's worker",
        ),
        Column("code_version", TEXT, "", "version of the program, with the commit where it ran from one"),
        Column("method_version", TEXT, "", "version of the method, raised when results may change"),
        Column("sources_sha256", TEXT, "", "digest of the sources that it was planned by"),
        Column("libraries", TEXT, "", "libraries that results depend on, with their versions"),
        Column("machine", TEXT, "", "processor and kernels of linear algebra of the run"),
        Column("planning_s", REAL, "s", "time it took to plan", low=0),
        Column("demonstration_sha256", TEXT, "", "of the demonstration that was read"),
        Column("source_sha256", TEXT, "", "of the source structure that was read"),
        Column("target_sha256", TEXT, "", "of the target structure that was read"),
        Column("settings_sha256", TEXT, "", "hash of all settings"),
        Column("settings_json", TEXT, "", "all settings"),
        Column("registration_json", TEXT, "", "how the target lies on the source, with the evidence"),
        Column("waypoints_sha256", TEXT, "", "hash of the waypoints; empty where there are none"),
        Column(
            "surface_sha256",
            TEXT,
            "",
            "hash of what is shown of the target, which is surfaces/<hash>.parquet",
        ),
        Column("inspected_sha256", TEXT, "", "hash of what of the source was inspected, kept likewise"),
        Column(
            "supposed_sha256",
            TEXT,
            "",
            "hash of what of the target was never scanned, which is supposed/<hash>.parquet; empty: nothing",
        ),
        Column(
            "imported_from",
            TEXT,
            "",
            "dataset that it came with, and whether its measures were computed again; empty: planned here",
        ),
        Column(
            "purpose",
            TEXT,
            "",
            "what it is for: empty, to be flown; `experiment NAME`, never current; `gap FLIGHT`, to show "
            "what that flight left out",
        ),
        *DECIDED,
        _id("key", "hash of everything the plan depends on"),
        *committed("when it was added", chained=False),
    ),
    ("transfer_id", "planned_at"),
)


_MEASURED = {item.name for item in fields(Measures)}

FLIGHTS = Table(
    "flights",
    "one row per flight of a plan, flown or in simulation",
    ("flight_id",),
    (
        _id("flight_id", "hash of the plan and of the log, or of wind, vehicle and seed"),
        _id("transfer_id", "the plan that was flown"),
        Column("waypoints_sha256", TEXT, "", "hash of the waypoints that were flown"),
        *AS_FLOWN,
        Column("wind_mps", REAL, "m/s", "mean speed of the wind, simulated or logged; null: neither", low=0),
        Column("wind_most_mps", REAL, "m/s", "the most that was logged", low=0),
        Column("towards_deg", REAL, "deg", "where it blows to, from +X counter-clockwise; null: not known"),
        Column("gusts", TRUTH, "", "with gusts"),
        Column("seed", WHOLE, "1", "of the gusts"),
        *(column for column in TRANSFERS.columns if column.name in _MEASURED),
        _id("flight_sha256", "hash of the flown path, which is flown/<hash>.parquet"),
        *committed("when it was added"),
    ),
    ("target_id", "added_at"),
)

TABLES = {
    table.name: table
    for table in (
        STRUCTURES,
        DEMONSTRATIONS,
        POSES,
        TRANSFERS,
        WAYPOINTS,
        FLIGHTS,
        DECISIONS,
        OVERRULED,
        SETTINGS,
        REQUIREMENTS,
        EDITS,
    )
}

#: The tables of steps, and whose rows own them.
STEPS = {"waypoints": "transfers", "poses": "demonstrations"}
