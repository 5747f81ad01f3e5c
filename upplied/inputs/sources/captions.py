"""Captions of DJI's videos (.srt), in the dialects of its models."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.sources.records import dated, source_of, times_of
from upplied.inputs.sources.source import MAX_ROWS, Fields, Source
from upplied.records import Floats

MAX_BYTES = 1 << 30
BLOCK = re.compile(r"^\d+\s*\n\d\d:\d\d:\d\d[,.]\d{3} --> ", re.MULTILINE)
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_CLOCK = re.compile(r"(\d\d):(\d\d):(\d\d)[,.](\d{3}) -->")
_GPS = re.compile(rf"(?<![A-Z])GPS ?\({_NUMBER}, ?{_NUMBER}(?:, ?{_NUMBER}(M?))?\)")
_CAPTIONS = {  # what a caption says -> the words before it
    "lat": r"latitude ?: ?", "lon": r"longt?itude ?: ?", "takeoff": r"rel_alt ?: ?",
    "alt": r"abs_alt ?: ?|altitude ?: ?", "baro": r"BAROMETER ?[:(] ?|, H ", "yaw": r"gb_yaw ?: ?",
    "pitch": r"gb_pitch ?: ?", "roll": r"gb_roll ?: ?", "focal": r"focal_len ?: ?",
}  # fmt: skip
_CAPTION = {name: re.compile(f"(?:{words}){_NUMBER}") for name, words in _CAPTIONS.items()}
_PRY = re.compile(rf"G\.PRY \({_NUMBER}\D*, {_NUMBER}\D*, {_NUMBER}")


def read(path: Path, fields: Fields) -> Source:
    """The flight that captions tell of; without an attitude in them it is positions alone."""
    text = read_regular(path, MAX_BYTES).decode("utf-8-sig", "replace").replace("\r\n", "\n")
    blocks = re.split(r"\n\s*\n(?=\d+\s*\n)", text.strip())[:MAX_ROWS]
    rows, since, dates = [], [], []
    for block in blocks:
        found = {name: float(hit[1]) for name, each in _CAPTION.items() if (hit := each.search(block))}
        if hit := _GPS.search(block):
            found |= {
                "first": float(hit[1]),
                "second": float(hit[2]),
                "latitude_first": float(hit[4] == "M" or "BAROMETER(" in block),
            }
        if hit := _PRY.search(block):
            found |= dict(zip(("pitch", "roll", "yaw"), map(float, hit.groups()), strict=True))
        clock = _CLOCK.search(block)
        rows.append(found)
        since.append(np.nan if clock is None else _ms(*map(int, clock.groups())))
        dates.append(dated(block))
    if not rows or not any(found.keys() & {"lat", "first"} for found in rows):
        raise InputError(
            str(path),
            f"has {len(blocks) if text.strip() else 0} captions, none with a place",
            "captions that say latitude and longitude",
            "let the camera record captions with GPS",
        )
    names = {name for found in rows for name in found}
    if {"lat", "first"} <= names:
        raise InputError(
            str(path), "holds captions of two kinds", "one flight", "split it where another camera begins"
        )
    columns = {name: np.array([found.get(name, np.nan) for found in rows]) for name in names}
    notes = []
    if "lat" not in columns:
        columns["lat"], columns["lon"], order = _ordered(columns)
        notes.append(order)
    if "takeoff" not in columns and "baro" in columns:
        columns["takeoff"] = columns["baro"]
    t_ns = times_of(np.array(since), np.array(dates), notes)
    return source_of("/captions", t_ns, columns, notes, path)


def _ordered(columns: dict[str, Floats]) -> tuple[Floats, Floats, str]:
    """Latitude and longitude of ``GPS(a, b, c)``: most models say longitude first, some do not."""
    first, second = columns["first"], columns["second"]
    if np.nanmax(np.abs(second)) > 90 or (np.nanmax(np.abs(first)) <= 90 and columns["latitude_first"].any()):
        return first, second, "captions say GPS(latitude, longitude)"
    return second, first, "captions say GPS(longitude, latitude)"


def _ms(hours: int, minutes: int, seconds: int, milliseconds: int) -> float:
    return ((hours * 60 + minutes) * 60 + seconds) * 1e3 + milliseconds
