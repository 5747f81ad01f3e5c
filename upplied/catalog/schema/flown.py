"""The columns of `flights` that say what was flown, how its log lies on its plan, and what was seen."""

from __future__ import annotations

from upplied.catalog.schema.columns import MOMENT, REAL, TEXT, WHOLE, Column

FLIGHT_KINDS = ("simulated", "flown")


def _share(name: str, meaning: str) -> Column:
    return Column(name, REAL, "%", meaning, low=0, high=100)


def _positive(name: str, unit: str, meaning: str) -> Column:
    return Column(name, REAL, unit, meaning, low=0)


AS_FLOWN = (
    Column("kind", TEXT, "", "simulated, or flown: read from a log; empty in older rows: simulated"),
    Column("demonstration_id", TEXT, "", "of the plan"),
    Column("target_id", TEXT, "", "the structure that was flown round"),
    Column("flown_at", MOMENT, "UTC", "first pose, by the log's clock; of a simulated one when it was made"),
    Column("log_sha256", TEXT, "", "hash of the log and of what was said of it"),
    Column("operator", TEXT, "", "who flew, as the log says"),
    Column("photos", WHOLE, "1", "photos whose times are known; null: none are, and the camera always sees"),
    Column("photos_missing", WHOLE, "1", "viewpoints that were passed without a photo", low=0),
    Column("clock_s", REAL, "s", "time of the log at which the plan begins; null: not flown in its times"),
    _positive("clock_error_s", "s", "one sigma of that"),
    _positive("shift_m", "m", "by how much the log was moved to lie on its plan"),
    _positive("place_error_m", "m", "how far off the positions may be; never less than they were moved"),
    Column("turn_deg", REAL, "deg", "by how much the log was turned about the vertical"),
    Column("camera_yaw_deg", REAL, "deg", "by how much the logged camera was turned"),
    Column("camera_pitch_deg", REAL, "deg", "the same, upwards"),
    _positive("residual_p95_m", "m", "distance of the log as corrected from the plan, 95th percentile"),
    _positive("cross_track_p95_m", "m", "distance of the log as it came from the plan, 95th percentile"),
    _positive("plan_frechet_m", "m", "Frechet distance between the flight and the part of the plan flown"),
    _share("flown_pct", "of the plan's length, the share that was flown"),
    _share("required_pct", "of what the plan shows, the share that was certainly seen"),
    _share("assumed_pct", "of it, the share seen besides if the log was rightly moved onto its plan"),
    _positive("silent_s", "s", "how long the log says nothing; the clearance then is not known"),
    Column("findings", TEXT, "", "broken off, resumed, stuck, silent, corrected: in words"),
    Column("looks_sha256", TEXT, "", "hash of the looks at each patch, which is looks/<hash>.parquet"),
)
