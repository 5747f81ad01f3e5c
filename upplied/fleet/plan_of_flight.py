"""Which plan a flight was of: the one that is named, or one of its place and time that it lies on best."""

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
from upplied.proof.align import Alignment, align, follows_exactly
from upplied.records import Demonstration

_MOST_STRUCTURES = 20  # that a log is laid on which names none: each time it is read again
_CLOCK_S = 86_400.0  # that the clock of a vehicle and that of the catalog may be apart, at most
_EARLIEST = datetime(2000, 1, 1, tzinfo=UTC)  # a clock before it was never set
_CLOSE_M, _MUCH_BETTER = 0.7, 0.5  # of a flight of its plan; of another plan, that it is said to be of
_MOST_PLANS, _MOST_FLIGHTS = 12, 5  # that a log is compared with besides
_OFF_PLAN_M = 10.0  # what a pose that belongs to no plan weighs, beside how far the others lie off


@dataclass(frozen=True)
class Laid:
    row: Row  # of the plan
    flown: Demonstration
    on: Alignment

    @property
    def off_m(self) -> float:
        return self.on.residual_p95_m + _OFF_PLAN_M * (1 - float(self.on.on_plan.mean()))


def plan_of_flight(catalog: Catalog, log: str, transfer_id: str, options: LogOptions) -> Laid:
    """Read a log and lay it on the plan that was flown.

    Refused where it lies on none, on another than is named, or is what was planned or simulated.
    """
    laid = _laid(catalog, log, transfer_id, options)
    _check_mission(catalog, log, laid)
    _check_flown(catalog, log, laid)
    return laid


def _laid(catalog: Catalog, log: str, transfer_id: str, options: LogOptions) -> Laid:
    if transfer_id:
        row = catalog.transfer(catalog.find_transfer(transfer_id))
        flown = _read(catalog, log, replace(options, structure_id=options.structure_id or row["target_id"]))
        if flown.structure_id != row["target_id"]:
            fault = f"was flown round {flown.structure_id}, plan {transfer_id} is for {row['target_id']}"
            raise InputError(log, fault, "a flight is judged on the plan that was flown")
        return _best(catalog, log, [(row, flown)])
    try:
        flown = _read(catalog, log, options)
        return _best(catalog, log, [(row, flown) for row in _plans(catalog, flown)])
    except InputError as error:
        if options.structure_id or error.rule != "a structure_id":
            raise
        return _best(catalog, log, list(_anywhere(catalog, log, options, error)))


def _check_flown(catalog: Catalog, log: str, laid: Laid) -> None:
    """Refuse a log whose poses are those of the plan, or of a simulated flight of it, to the centimetre."""
    name = laid.row["transfer_id"]
    simulated = catalog.flights(name, kind="simulated").drop_duplicates("flight_sha256", keep="last")
    planned = catalog.plan(name).trajectory
    assert planned is not None
    flights = map(catalog.flown, simulated["flight_sha256"][-_MOST_FLIGHTS:])
    for what, path in [("plan", planned), *(("simulated flight", path) for path in flights)]:
        if follows_exactly(path, laid.on):
            fault = f"holds the poses of the {what} {name} itself"
            fault += ": no vehicle follows a path to the centimetre"
            raise RefusedError(log, fault, "the log of a vehicle that flew")


def _check_mission(catalog: Catalog, log: str, laid: Laid) -> None:
    """Refuse a flight of another mission than the one that it is laid on: it lies far better on that one."""
    if laid.off_m < _CLOSE_M:
        return
    row = laid.row
    every = catalog.transfers(structure=row["target_id"], status="ok", every=True)["transfer_id"]
    others = every[every != row["transfer_id"]][-_MOST_PLANS:]
    rows = _before_flight([catalog.transfer(str(name)) for name in others], laid.flown)
    try:
        best = _best(catalog, log, [(row, laid.flown) for row in rows])
    except RefusedError:
        return
    if best.off_m < _MUCH_BETTER * laid.off_m:
        name = best.row["transfer_id"]
        fault = f"is a flight of plan {name}, on which it lies to {best.off_m:.1f} m"
        fault += f"; on plan {row['transfer_id']} to {laid.off_m:.1f} m"
        raise RefusedError(log, fault, "the plan that was flown", f"say --plan {name}")


def _anywhere(
    catalog: Catalog, log: str, options: LogOptions, unsaid: InputError
) -> Iterator[tuple[Row, Demonstration]]:
    """The plans of the structures that people released plans for last, and the log as flown round each."""
    rows = catalog.in_force()
    if len(rows):
        rows = rows.sort_values("state_at", kind="stable").iloc[::-1]
    else:
        rows = catalog.transfers(status="ok", preset="recommended")
    if not (names := list(dict.fromkeys(rows["target_id"]))):
        raise unsaid
    for name in names[:_MOST_STRUCTURES]:
        try:
            flown = _read(catalog, log, replace(options, structure_id=name))
        except InputError:
            continue  # of a log in the world's coordinates: that structure stands elsewhere, or nowhere known
        yield from ((row, flown) for row in _plans(catalog, flown))


def _best(catalog: Catalog, log: str, tried: list[tuple[Row, Demonstration]]) -> Laid:
    candidates, why = list[Laid](), []
    for row, flown in tried:
        try:
            plan = catalog.plan(row["transfer_id"])
            if plan.trajectory is None:
                raise RefusedError(f"plan {row['transfer_id']}", f"has no path: it is {plan.status}")
            on = align(plan.trajectory, flown.trajectory, flown.accuracy_m)
        except RefusedError as refusal:
            why.append(f"{row['transfer_id']}: {refusal}")
            continue
        candidates.append(Laid(row, flown, on))
    if not candidates:
        known = "; ".join(why) or "no plan of that structure is in the catalog"
        raise RefusedError(log, f"lies on no plan: {known}", "", "state which plan was flown: --plan ID")
    return min(candidates, key=lambda laid: laid.off_m)


def _plans(catalog: Catalog, flown: Demonstration) -> list[Row]:
    """Plans of a structure, in force now or when it was flown, else newest; made before the flight."""
    moment = moment_of(int(flown.t_ns[0]))
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
    return _before_flight(rows, flown)


def _before_flight(rows: list[Row], flown: Demonstration) -> list[Row]:
    """Those of the plans that were made before a flight; all where none was: its clock is wrong."""
    late = moment_of(int(flown.t_ns[0])) + timedelta(seconds=_CLOCK_S)
    return [row for row in rows if row["added_at"] is None or row["added_at"] <= late] or rows


def _read(catalog: Catalog, log: str, options: LogOptions) -> Demonstration:
    if options.structure_id:
        placement = catalog.structure(options.structure_id).placement
        placements = {} if placement is None else {options.structure_id: placement}
    else:
        placements = placements_of(catalog.structures())
    flown = read_demonstration(Path(log), options, placements, flight=True)
    begins, latest = moment_of(int(flown.t_ns[0])), catalog.clock.now() + timedelta(seconds=_CLOCK_S)
    if not _EARLIEST <= begins <= latest:
        remedy = "set the recorder's clock, or correct the stamps of the log and of its photos alike"
        fault = f"begins on {begins:%Y-%m-%d} by its own clock"
        raise InputError(log, fault, f"a date from {_EARLIEST:%Y} to now", remedy)
    return flown


def moment_of(t_ns: int) -> datetime:
    """A time of a log, ns since 1970, to the microsecond."""
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t_ns // 1000)
