"""Findings and the history of their states, and the photos of flights that they are seen in."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from upplied.catalog.schema.rows import ADDED, Row
from upplied.catalog.schema.tables import BEFORE_SHA256
from upplied.catalog.verbs import queries
from upplied.catalog.verbs.adding import Adding
from upplied.catalog.verbs.queries import When, moment
from upplied.catalog.verbs.roster import author
from upplied.errors import SettingsError
from upplied.provenance import code_version

STATES = ("open", "watched", "repaired", "dismissed")
_LONGEST = 2000  # letters of a class, a severity or a note
_TURNS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}  # direction of writing


def check_text(what: str, name: str, text: str) -> None:
    """Refuse a text that is too long, has control letters or turns the direction of writing."""
    if len(text) > _LONGEST:
        raise SettingsError(what, f"its {name} is longer", f"at most {_LONGEST} letters")
    for letter in text:
        turns = unicodedata.bidirectional(letter) in _TURNS
        if turns or (unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t"):
            remedy = "write it in letters, digits and signs"
            raise SettingsError(what, f"its {name} has {letter!a}, which nobody sees", "", remedy)


class Finding(Adding):
    """A catalog that holds what was found on structures; see `upplied.catalog.Catalog`."""

    def findings(
        self,
        *,
        structure: str | None = None,
        kind: str | None = None,
        state: str | None = None,
        class_name: str | None = None,
        since: When | None = None,
        history: bool = False,
    ) -> pd.DataFrame:
        """Findings as they stand, in the order of their first commits; with `history`, every row of them.

        Parameters
        ----------
        structure, kind, class_name : str, optional
            That they are on, and what they are, as `class` has it.
        state : {"open", "watched", "repaired", "dismissed"}, optional
        since : datetime or str, optional
            First added at this moment or later.
        history : bool
            Every change of state as well, in the order of commits.
        """
        rows = self.by_commit("findings", target_id=structure, kind=kind)
        first = rows.drop_duplicates("finding_id")
        newest = rows.drop_duplicates("finding_id", keep="last").set_index("finding_id", drop=False)
        newest = newest.loc[list(first["finding_id"])]
        if state is not None:
            newest = newest[newest["state"] == state]
        if class_name is not None:
            newest = newest[newest["class"] == class_name]
        if since is not None:
            newest = newest[newest.index.isin(first["finding_id"][first["added_at"] >= moment(since)])]
        entries = rows[rows["finding_id"].isin(newest.index)] if history else newest
        return entries.reset_index(drop=True)

    def finding(self, start: str) -> Row:
        """The newest row of the one finding whose id begins so; none, or more than one, is an error."""
        return queries.beginning(self.findings(), "finding", start)

    def add_findings(self, findings: Sequence[Mapping[str, Any]], by: str) -> list[str]:
        """Add rows of `findings` without entry, author and commit; the ids of those that were not known."""
        who = author(by, "a finding")
        known = set(self.findings()["finding_id"])
        new = {str(row["finding_id"]): row for row in findings if row["finding_id"] not in known}
        self.add_rows("findings", [self._entry(row, who) for row in new.values()])
        return list(new)

    def set_finding(self, start: str, state: str, by: str, note: str = "") -> Row:
        """Change the state of a finding: one more row, which counts from then on; that row."""
        if state not in STATES:
            raise SettingsError(f"state {state!r}", "is unknown", f"one of {', '.join(STATES)}")
        row = self._entry({**self.finding(start), "state": state, "note": note}, author(by, "a finding"))
        self.add_rows("findings", [row])
        return row

    def flight_photos(self, flight_id: str | None = None, *, structure: str | None = None) -> pd.DataFrame:
        """Photos of flights that were registered, of one flight, of one structure, or all.

        Of what was registered of a file, or of its name and bytes in another folder, the newest row counts.
        """
        rows = self.by_commit("flight_photos", flight_id=flight_id, target_id=structure)
        for same in (["name", "sha256"], ["path"]):
            rows = rows.drop_duplicates(["flight_id", *same], keep="last")
        return rows.reset_index(drop=True)

    def add_flight_photos(self, photos: Sequence[Mapping[str, Any]], by: str = "") -> int:
        """Register photos of flights in one commit; how many were new."""
        known = set(self.flight_photos()[["photo_id", "path"]].itertuples(index=False, name=None))
        new = {str(row["photo_id"]): {**row, "by": by}
               for row in photos if (row["photo_id"], row["path"]) not in known}  # fmt: skip
        return self.add_rows("flight_photos", list(new.values()))

    def _entry(self, row: Mapping[str, Any], by: str) -> Row:
        for name in ("class", "severity", "note", "file"):
            check_text(f"finding {row['finding_id']}", name, str(row.get(name) or ""))
        drop = (*ADDED, BEFORE_SHA256)
        values = {name: value for name, value in row.items() if name not in drop and value == value}
        return values | {"entry_id": self.new_commit_id(), "by": by, "code_version": code_version()}
