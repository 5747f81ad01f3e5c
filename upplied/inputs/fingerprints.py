"""What a flight is known by: the hash of its bytes and of the facts about it."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from upplied.config import digest
from upplied.inputs.mcap.recording import open_recording
from upplied.inputs.passport.settings import SHAPING, PassportSettings
from upplied.inputs.sidecar import LogOptions, inspection, placed
from upplied.inputs.sources import door
from upplied.records import Placement

# Facts that change nothing of a flight, and those that came later and leave the hash of older logs alone.
_UNHASHED = ("demonstration_id", "allow", "strict", "passport")
_LATER = (
    "publisher", "convention", "unit_m", "takeoff_alt_m", "points", "body_T_antenna_position_m",
    "camera_model", "camera_file_format", "camera_width_px", "camera_height_px", "camera_exposure_s",
    "camera_trigger_s", "camera_focus_m", "camera_focal_mm", "camera_f_number", "camera_distortion",
    "camera_distortion_model", "camera_middle_px", "accuracy_m",
)  # fmt: skip
_PHOTO_HEAD = 1 << 17  # bytes by which a photo is known: reading all of them would take longer than the rest


def fingerprint(
    path: str | Path, options: LogOptions | None = None, placements: Mapping[str, Placement] | None = None
) -> tuple[str, str]:
    """The id and the hash that `read_demonstration` would give; no message is read.

    The hash differs where facts about the flight stand among the messages of a damaged log: such a log is
    read to be known.

    Raises
    ------
    InputError, OSError
        If the file cannot be read or is no log.
    """
    path = Path(path)
    kind = door.kind_of(path)
    metadata = open_recording(path).metadata if kind == "mcap" else []
    facts, _ = inspection(path, metadata, options or LogOptions())
    facts = placed(facts, (placements or {}).get(facts.structure_id))
    return facts.demonstration_id, digest_of(sha256_of(path, kind), facts)


def digest_of(log: str, facts: LogOptions) -> str:
    """The hash of a flight: of the hash of its bytes and of all facts about it."""
    hashed = {
        name: value
        for name, value in vars(facts).items()
        if name not in _UNHASHED and (value or name not in _LATER)
    }
    shaped = {name: getattr(facts.passport, name) for name in SHAPING}
    if shaped != {name: getattr(PassportSettings(), name) for name in SHAPING}:
        hashed["shaped"] = shaped
    return digest({"log": log, "said": hashed})


def sha256_of(path: Path, kind: str) -> str:
    """The hash of the bytes of a file; where several hold a flight, of all of them, photos by their heads."""
    names = door.parts_of(path, kind)
    whole = hashlib.sha256()
    for name in names:
        with name.open("rb") as stream:
            if names == [path]:
                return hashlib.file_digest(stream, "sha256").hexdigest()
            whole.update(f"{name.name}\0{name.stat().st_size}\0".encode())
            if kind == "photos":
                whole.update(stream.read(_PHOTO_HEAD))
            else:
                whole.update(hashlib.file_digest(stream, "sha256").digest())
    return whole.hexdigest()
