"""What a person decides about a plan on its page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.catalog import Catalog
from upplied.catalog.verbs.standing import unit_of
from upplied.errors import InputError
from upplied.web.requests import signed

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
