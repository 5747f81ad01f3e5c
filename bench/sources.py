"""One known flight in every form that is read, and conventions that were mistaken in some of them.

    python bench/sources.py          the table of forms
    python bench/sources.py 500      besides, so many logs in a wrong convention, over five forms

Forms: the largest error of position, attitude and time beside the flight that was written. Conventions: right
logs must be read, wrong ones refused or repaired with the name of the convention.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from made_flights import Made, right
from made_logs import Flight, flight
from made_sources import UNTIMED, WRITERS

from upplied.errors import InputError
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.passport.conventions import NAMED
from upplied.poses import angle_between

_FORMS = ("mcap", "ros1", "tum", "euroc", "opensfm")
_POSES = 300  # of a flight that is written in a wrong convention


def forms() -> None:
    """Print the errors of each form."""
    print(f"{'form':16}{'position mm':>12}{'attitude deg':>14}{'time ms':>10}")
    for form, write in WRITERS.items():
        flown = flight(1200, 10.0)
        step = 30 if form == "photos" else 10
        flown = Flight(*(part[::step] for part in (flown.t_ns, flown.positions, flown.quat_xyzw)))
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "flight" if form in ("photos", "ros2") else Path(folder)
            path, facts = write(place, flown)
            found = read_demonstration(path, LogOptions(structure_id="tank", **facts))
        off_m = np.abs(found.positions - flown.positions).max()
        turned = np.degrees(angle_between(found.quat_xyzw, flown.quat_xyzw)).max()
        late_ns = np.abs(found.t_ns - flown.t_ns - (found.t_ns[0] - flown.t_ns[0]) * (form == "kitti")).max()
        late = "none" if form in UNTIMED else f"{late_ns * 1e-6:.3f}"
        print(f"{form:16}{1000 * off_m:12.3f}{turned:14.5f}{late:>10}", flush=True)


def judged(log: Made, form: str, folder: Path, convention: str = "") -> str:
    """The rule that refuses a log, "" where it is read, or the convention that its refusal names."""
    some = np.unique(np.linspace(0, len(log) - 1, _POSES).astype(int))
    place = Path(tempfile.mkdtemp(dir=folder))
    path, facts = WRITERS[form](place, Flight(log.t_ns[some], log.positions[some], log.quats[some]))
    names = {"structure_id": log.structure.structure_id, "max_dropped": 1.0}
    options = LogOptions(**(facts | {"body_frame": "camera"} | names))
    try:
        read_demonstration(path, options, structures=lambda name: log.structure)
    except InputError as error:
        return convention if convention and f"({convention})" in str(error) else "refused"
    return ""


def conventions(count: int) -> None:
    """Print what becomes of logs in a wrong convention, and of right ones."""
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            name, form = list(NAMED)[number % len(NAMED)], _FORMS[number % len(_FORMS)]
            log = right(number // len(NAMED))
            quats = log.quats / np.linalg.norm(log.quats, axis=1, keepdims=True)
            positions, turns = NAMED[name].change(log.positions, quats)
            result = judged(replace(log, positions=positions, quats=turns), form, Path(folder), name)
            total["named" if result == name else result or f"passed: {name}"] += 1
            if number % len(NAMED) == 0:
                total["right refused" if judged(log, form, Path(folder)) else "right read"] += 1
    for result, times in total.most_common():
        print(f"{result:40}{times:6}")


if __name__ == "__main__":
    forms()
    if len(sys.argv) > 1:
        conventions(int(sys.argv[1]))
