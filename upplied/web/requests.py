"""What requests of our pages carry, checked; and what a person decides about a plan on its page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs.standing import unit_of
from upplied.errors import InputError
from upplied.fleet.edits import FARTHEST_M, viewpoint_of
from upplied.proof.edit import Viewpoint

_WORDS = {"reviewed": "is reviewed", "released": "is released", "rejected": "is rejected"}


class Decisions:
    """Decisions about the plans of a catalog.

    Parameters
    ----------
    catalog : Catalog
    """

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog

    def last(self, transfer_id: str) -> str:
        """The last decision about the pair of a plan; empty where there is none."""
        rows = self.catalog.transfers(every=True, ids=[transfer_id]).to_dict("records")
        return self.catalog.standing().last.get(unit_of(rows[-1]), "") if rows else ""

    def decide(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Review, release or reject a plan.

        A release names the last decision that its page shows, ``known``: where somebody decided since, it
        is refused.

        Raises
        ------
        UppliedError
            If the request cannot be read, or the decision is refused.
        """
        by, note = signed(request)
        decision, plan = request.get("decision"), self.catalog.find_transfer(str(request.get("id", "")))
        if decision == "reviewed":
            self.catalog.review(plan, by, note)
        elif decision == "released":
            self.catalog.release(plan, by, note, after=str(request.get("known", "")))
        elif decision == "rejected":
            self.catalog.reject(plan, by, note)
        else:
            raise InputError("the decision", f"is {str(decision)[:40]!r}", "reviewed, released or rejected")
        message = f"Plan {plan} {_WORDS[decision]} by {by}."
        return {"id": plan, "message": message, "known": self.last(plan)}


def signed(request: Mapping[str, Any]) -> tuple[str, str]:
    """The name and the note that a request carries; one without a name is refused."""
    by, note = request.get("by", ""), request.get("note", "")
    if not isinstance(by, str) or not isinstance(note, str) or not by.strip():
        raise InputError("the decision", "has no name", "who decides", "write your name")
    return by.strip(), note


def text_of(request: Mapping[str, Any], name: str) -> str:
    """The text of this name."""
    value = request.get(name)
    if not isinstance(value, str):
        raise InputError(name, "is not a text")
    return value


def place_looked_from(request: Mapping[str, Any]) -> Viewpoint:
    """The viewpoint that a request describes."""
    try:
        viewpoint = viewpoint_of(request)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("the viewpoint", "cannot be read", "x_m, y_m, z_m, yaw_deg and pitch_deg") from None
    values = [*viewpoint.position, viewpoint.yaw_deg, viewpoint.pitch_deg]
    if not np.isfinite(values).all() or max(map(abs, viewpoint.position)) > FARTHEST_M:
        raise InputError(
            "the viewpoint", "is out of range", f"finite, at most {FARTHEST_M:g} m from the origin"
        )
    return viewpoint
