"""What of the gate a plan's own row can tell: whether its trajectory may leave to be flown.

The steps of a row are compared with its hash whenever they are read, so they are those that were judged
when they were planned: clearance, surroundings, speed and all other floors stand in the row's verdict.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from upplied.catalog.schema.plan_rows import is_foreign
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs import custody, ordering
from upplied.errors import RefusedError

if TYPE_CHECKING:
    from upplied.catalog.verbs.decisions import Deciding

#: Of a row of `transfers`, what `check_leaves` asks.
ASKED = ("transfer_id", "demonstration_id", "target_id", "preset", "not_flyable", "imported_from")


def check_leaves(catalog: Deciding, row: Row, force: Collection[str] = ()) -> None:
    """Refuse a plan that is for comparison, falls short of its floors, or has been followed by another.

    Parameters
    ----------
    catalog : Catalog
    row : mapping
        Of `transfers`, with the columns of `ASKED`.
    force : collection of str
        Rules that are overruled: ``preset``, ``verdict``, ``foreign``, ``altered``, ``rejected``,
        ``recalled``, ``superseded`` (docs/checks.md).

    Raises
    ------
    RefusedError
    """
    found = {}
    if row["preset"] != "recommended":
        found["preset"] = f"the plan is of preset {row['preset']}, which is for comparison"
    if row["not_flyable"]:
        found["verdict"] = str(row["not_flyable"])
    if is_foreign(row):
        found["foreign"] = custody.FOREIGN_PLAN[0]
    now = catalog.standing()
    state = now.of(row["transfer_id"])
    for wrong in custody.alterations(catalog, [row["transfer_id"]], now).values():
        found["altered"] = wrong
    if state in ("rejected", "recalled", "superseded"):
        found[state] = f"the plan is {state}"
    elif state != "released" and ordering.superseded(catalog.tables["transfers"], [row]):
        found["superseded"] = "a newer plan of this pair and preset took its place"
    left = {rule: said for rule, said in found.items() if rule not in force}
    if left:
        names = ", ".join(f'"{rule}"' for rule in left)
        remedy = f"to look at it: plan() or waypoints(); to fly it all the same: force=[{names}]"
        told = "; ".join(f"{rule}: {said}" for rule, said in left.items())
        raise RefusedError(f"transfer {row['transfer_id']}", told, "only what may be flown leaves", remedy)
