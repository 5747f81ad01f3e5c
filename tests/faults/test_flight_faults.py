"""Logs that went wrong are refused or named; logs that are right are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases import slow_after
from made_flights import FAULTS, NAMED, Log, right

from upplied.errors import UppliedError
from upplied.inputs.logs import LogOptions, read_demonstration


def verdict(log: Log, path: Path) -> tuple[str, str]:
    """What is said of a log: "refused" and why, or the verdict and the rules it breaks."""
    try:
        demonstration = read_demonstration(log.write(path), LogOptions(), structures=lambda _: log.structure)
    except UppliedError as error:
        return "refused", str(error)
    rules = " ".join(item["rule"] for item in demonstration.passport["findings"])
    return str(demonstration.passport["verdict"]), rules


def caught(fault: str, number: int, path: Path) -> bool:
    """Whether the log of this number with this fault is refused, or its fault is named."""
    log = FAULTS[fault](right(number), np.random.default_rng([number, 11]))
    what, rules = verdict(log, path)
    return what == "refused" or (fault in NAMED and NAMED[fault] in rules)


# tests/inputs/test_passport.py shows with what words these are refused.
REFUSED_BY_NAME = {
    "ned", "w_first", "optical", "swapped", "feet", "mirrored", "two_vehicles", "unconnected", "many_gaps",
    "yaw_drift",
}  # fmt: skip


@pytest.mark.parametrize("fault", slow_after(7, sorted(FAULTS.keys() - REFUSED_BY_NAME)))
def test_a_fault_is_refused_or_named(tmp_path: Path, fault: str) -> None:
    assert sum(caught(fault, number, tmp_path / "a.mcap") for number in (0, 4, 6)) >= 2


@pytest.mark.slow
def test_of_500_wrong_logs_98_percent_are_refused_or_named(tmp_path: Path) -> None:
    names = sorted(FAULTS)
    missed = [
        (names[number % len(names)], number)
        for number in range(504)
        if not caught(names[number % len(names)], number // len(names), tmp_path / "a.mcap")
    ]
    assert len(missed) <= 10, missed


@pytest.mark.slow
def test_of_200_right_logs_one_percent_is_refused_at_most(tmp_path: Path) -> None:
    refused = [
        (number, rules)
        for number in range(200)
        for what, rules in [verdict(right(number), tmp_path / "a.mcap")]
        if what == "refused"
    ]
    assert len(refused) <= 2, refused
