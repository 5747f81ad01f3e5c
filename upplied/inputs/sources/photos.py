"""A folder of drone photos: positions, times and cameras of EXIF, attitudes of XMP. Heads alone are read.

The gimbal's yaw counts from true north, on some small models from the nose, which a series shows. Heights
count from take-off, since other datums are unknown, unless RTK fixed them.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from upplied.cameras import named_by_exif
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.photo_tags import head_of
from upplied.inputs.sources.source import Fields, Source, refusal
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

ENDINGS = (".jpg", ".jpeg", ".dng", ".tif", ".tiff")
MAX_PHOTOS = 100_000
_RTK_FIXED, _RTK_M = 50, 0.05
_NADIR_DEG, _TURN_DEG, _STILL_DEG = 85.0, 60.0, 15.0


def members(folder: Path) -> list[Path]:
    """The photos that lie in a folder, by name."""
    names = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.is_file())
    return names[: MAX_PHOTOS + 1]


def read(path: Path, fields: Fields) -> Source:
    """The looks of a folder of photos, or of one photo."""
    names = members(path) if path.is_dir() else [path]
    if len(names) > MAX_PHOTOS:
        raise refusal(f"holds more than {MAX_PHOTOS} photos", "one flight", "split the folder")
    with ThreadPoolExecutor(4) as threads:
        heads = list(threads.map(head_of, names))
    placed = [
        head for head in heads if np.isfinite(head["lat"] + head["lon"]) and (head["lat"] or head["lon"])
    ]
    finding = f"{len(placed)} of {len(heads)} photos have a place"
    if len(placed) < 2:
        remedy = "copy the originals: programs that resize or edit photos drop their tags"
        raise refusal(finding, "at least two", remedy)
    notes: list[str] = []
    models = sorted({head.pop("camera") for head in placed})
    if len(models) > 1:
        finding = f"holds photos of {len(models)} cameras ({', '.join(models[:5])})"
        raise refusal(finding, "one flight", "put the photos of each flight into a folder of its own")
    at = {name: np.array([head[name] for head in placed], float) for name in placed[0]}
    t_ns = _times(at["t_ms"], notes)
    order = np.argsort(t_ns, kind="stable")
    at, t_ns = {name: column[order] for name, column in at.items()}, t_ns[order]
    facts = _lens(at, models[0]) | ({"accuracy_m": _accuracy_m(at)} if _fixed(at) else {})
    timed = bool(np.isfinite(at["t_ms"]).all())
    lost = [finding] if len(placed) < len(heads) else []
    return Source(
        [*_tables(at, t_ns, notes)], [], lost, notes=notes, stills=True, defaults=facts, timed=timed
    )


def _lens(at: dict[str, Floats], model: str) -> dict[str, Any]:
    """What EXIF says of camera and lens, as facts: of exposures the longest, which blurs the most."""
    counts: dict[str, Any] = {"exposure_s": np.max, "f_number": np.median, "focal_mm": np.median}
    known = {name: at[name][np.isfinite(at[name]) & (at[name] > 0)] for name in counts}
    facts: dict[str, Any] = {
        f"camera_{name}": float(counts[name](values)) for name, values in known.items() if len(values)
    }
    name = named_by_exif(model, facts.get("camera_focal_mm", 0.0))
    return facts | ({"camera_model": name} if name else {})


def _fixed(at: dict[str, Floats]) -> bool:
    """Whether RTK fixed the place of every photo."""
    return bool((at["rtk"] == _RTK_FIXED).all() and np.isfinite(at["absolute"]).all())


def _accuracy_m(at: dict[str, Floats]) -> float:
    """One sigma of the worst place that RTK fixed, m; what is usual where some photo does not state it."""
    sigma = np.sqrt(at["sigma"] ** 2 + at["sigma_east"] ** 2 + at["sigma_north"] ** 2)
    return float(sigma.max()) if np.isfinite(sigma).all() else _RTK_M


def _tables(at: dict[str, Floats], t_ns: Ints, notes: list[str]) -> Iterator[Table]:
    def mostly(name: str) -> bool:
        return bool(np.isfinite(at[name]).mean() >= 0.5)

    if _fixed(at):
        notes.append(f"fixed by RTK to {_accuracy_m(at):.2f} m")
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt_ellipsoid=at["absolute"])
    elif mostly("relative"):
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt_takeoff=at["relative"])
    elif mostly("exif_alt"):
        notes.append("altitudes of EXIF are taken to be above mean sea level")
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt=at["exif_alt"])
    else:
        raise refusal("photos hold no height", "a height above take-off or sea level", "use the originals")
    if mostly("pitch"):
        yield fill.gimbals("/photos", t_ns, _yaw(at, notes), at["pitch"], np.nan_to_num(at["roll"]))
    elif mostly("flight"):
        notes.append("no gimbal in the photos: the camera is taken to look ahead, level")
        yield fill.attitudes("/photos", t_ns, at["flight"], 0 * at["flight"], 0 * at["flight"])
    if np.isfinite(at["focal_px"]).any() and np.isfinite(at["width"]).any():
        yield fill.cameras("/photos", t_ns, at["width"], at["height"], at["focal_px"])


def _yaw(at: dict[str, Floats], notes: list[str]) -> Floats:
    """Yaw from north: where it stays near 0 while the aircraft turns, it counts from the nose."""
    yaw, flight = at["gimbal"], at["flight"]
    known = np.isfinite(yaw) & np.isfinite(flight)
    steep = np.abs(at["pitch"]) > _NADIR_DEG
    some = known & ~steep if (known & ~steep).sum() >= 5 else known  # of a nadir yaw half a turn may be off
    turns = np.unwrap(np.radians(flight[some])) if some.any() else np.zeros(1)
    relative = np.abs((yaw[some] + 180) % 360 - 180)
    if some.sum() >= 3 and np.degrees(np.ptp(turns)) > _TURN_DEG and np.percentile(relative, 90) < _STILL_DEG:
        notes.append("the gimbal's yaw counts from the aircraft's nose here: the aircraft's is added")
        return np.where(known, yaw + flight, np.nan)
    if known.any() and steep[known].mean() > 0.5:
        notes.append("most photos look straight down: which way is up in them is known to half a turn")
    return np.where(np.isfinite(yaw), yaw, flight)


def _times(t_ms: Floats, notes: list[str]) -> Ints:
    """Times, ns, of photos in the order of their names; those of one second are spread over it."""
    if not np.isfinite(t_ms).all():
        notes.append("not all photos hold a time: by their names, one every 2 s")
        return fill.numbered(len(t_ms))
    notes.append("times of photos are taken to be UTC where they name no zone")
    return fill.spread(np.round(t_ms * 1e6).astype(np.int64))
