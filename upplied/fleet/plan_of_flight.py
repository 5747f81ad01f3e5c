"""Which plan a flight was of: the one that is named, or one of its place and time that it lies on best."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.errors import InputError, RefusedError
from upplied.fleet.ingest import placements_of
from upplied.inputs.logs import read_demonstration
from upplied.inputs.sidecar import LogOptions
from upplied.proof.align import Alignment, align
from upplied.records import Demonstration, Placement

_MOST_STRUCTURES = 20  # that a log is laid on which names none: each time it is read again
_CLOCK_S = 86_400.0  # that the clock of a vehicle and that of the catalog may be apart, at most
_OFF_PLAN_M = 10.0  # what a pose that belongs to no plan weighs, beside how far the others lie off


@dataclass(frozen=True)
class Laid:
    """A flight on its plan."""

    row: Row  # of the plan
    flown: Demonstration
    on: Alignment


def plan_of_flight(catalog: Catalog, log: str, transfer_id: str, options: LogOptions) -> Laid:
    """Read a log and lay it on the plan that was flown.

    Raises
    ------
    InputError
        If the log cannot be read, or is of another structure than the plan that is named.
    RefusedError
        If it lies on no plan.
    """
    if transfer_id:
        row = catalog.transfer(catalog.find_transfer(transfer_id))
        flown = _read(catalog, log, replace(options, structure_id=options.structure_id or row["target_id"]))
        if flown.structure_id != row["target_id"]:
            found = f"was flown round {flown.structure_id}, plan {transfer_id} is for {row['target_id']}"
            raise InputError(log, found, "a flight is judged on the plan that was flown")
        return _best(catalog, log, [(row, flown)])
    try:
        flown = _read(catalog, log, options)
        return _best(catalog, log, [(row, flown) for row in _plans(catalog, flown)])
    except InputError as error:
        if options.structure_id or error.rule != "a structure_id":
            raise
        return _best(catalog, log, list(_anywhere(catalog, log, options, error)))


def _anywhere(
    catalog: Catalog, log: str, options: LogOptions, unsaid: InputError
) -> Iterator[tuple[Row, Demonstration]]:
    """The plans of the structures that people released plans for last, and the log as flown round each."""
    force = catalog.in_force()
    asked = (
        force.sort_values("state_at", kind="stable")["target_id"].iloc[::-1]
        if len(force)
        else catalog.transfers(status="ok", preset="recommended")["target_id"]
    )
    names = list(dict.fromkeys(asked))
    if not names:
        raise unsaid
    for name in names[:_MOST_STRUCTURES]:
        try:
            flown = _read(catalog, log, replace(options, structure_id=name))
        except InputError:
            continue  # of a log in the world's coordinates: that structure stands elsewhere, or nowhere known
        yield from ((row, flown) for row in _plans(catalog, flown))


def _best(catalog: Catalog, log: str, tried: list[tuple[Row, Demonstration]]) -> Laid:
    """The plan that the path lies on best."""
    found: list[tuple[float, Laid]] = []
    why = []
    for row, flown in tried:
        try:
            plan = catalog.plan(row["transfer_id"])
            if plan.trajectory is None:
                raise RefusedError(f"plan {row['transfer_id']}", f"has no path: it is {plan.status}")
            on = align(plan.trajectory, flown.trajectory)
        except RefusedError as refusal:
            why.append(f"{row['transfer_id']}: {refusal}")
            continue
        off = on.residual_p95_m + _OFF_PLAN_M * (1 - float(on.on_plan.mean()))
        found.append((off, Laid(row, flown, on)))
    if not found:
        known = "; ".join(why) or "no plan of that structure is in the catalog"
        raise RefusedError(log, f"lies on no plan: {known}", "", "say which plan was flown: --plan ID")
    return min(found, key=lambda each: each[0])[1]


def _plans(catalog: Catalog, flown: Demonstration) -> list[Row]:
    """The plans of a structure that a flight may be of.

    Those in force now or when it was flown, else the newest; none that was made after it, unless no other
    was, which is a clock that is wrong.
    """
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(flown.t_ns[0]) // 1000)
    structure = flown.structure_id
    force = catalog.in_force(structure=structure)
    try:
        then = catalog.transfers(structure=structure, in_force=True, as_of=moment.isoformat())
    except (ValueError, OverflowError):
        then = force.iloc[:0]
    names = pd.concat([force["transfer_id"], then["transfer_id"]])
    if not len(names):
        names = catalog.transfers(structure=structure, status="ok", preset="recommended")["transfer_id"]
    rows = [catalog.transfer(str(name)) for name in dict.fromkeys(names)]
    late = moment + timedelta(seconds=_CLOCK_S)
    before = [row for row in rows if row["added_at"] is None or row["added_at"] <= late]
    return before or rows


def _read(catalog: Catalog, log: str, options: LogOptions) -> Demonstration:
    return read_demonstration(Path(log), options, _placements(catalog, options.structure_id))


def _placements(catalog: Catalog, structure_id: str) -> dict[str, Placement]:
    if not structure_id:
        return placements_of(catalog.structures())
    placement = catalog.structure(structure_id).placement
    return {} if placement is None else {structure_id: placement}
