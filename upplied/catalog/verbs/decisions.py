"""What people decide about plans and find on structures, and what the check of a changed structure finds.

Each release names the last decision that it knew of; of two at once the second commit does not count.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from upplied.catalog.schema.rows import ADDED, Row
from upplied.catalog.schema.tables import BEFORE_SHA256
from upplied.catalog.verbs import custody, queries
from upplied.catalog.verbs.belonging import OwnSettings
from upplied.catalog.verbs.ordering import PAIR, Standing, by_commit, standing_of, unit_of
from upplied.catalog.verbs.queries import When, moment
from upplied.catalog.verbs.roster import Roster, author, check_text, signature
from upplied.errors import RefusedError, SettingsError
from upplied.provenance import code_version

#: Rules that a release keeps unless it is forced by their names, and why.
RELEASE_RULES = {
    "preset": "only `recommended` is meant to be flown",
    "verdict": "the plan reaches what it must to be flown",
    "rejected": "nobody rejected it",
    "recalled": "it was not recalled",
    "changed": "the structure has not changed since it was planned",
}
STATES = ("open", "watched", "repaired", "dismissed")  # of findings


class Deciding(OwnSettings):
    """A catalog of plans that are decided about, and of findings; see `upplied.catalog.Catalog`."""

    def decisions(self, transfer_id: str | None = None) -> pd.DataFrame:
        """What was decided about plans, in the order of commits; about one, or all."""
        return self.by_commit("decisions", transfer_id=transfer_id)

    def standing(self) -> Standing:
        """What follows from all decisions."""
        return standing_of(by_commit(self.tables["decisions"].read()))

    def in_force(self, *, structure: str | None = None, kind: str | None = None) -> pd.DataFrame:
        """The plans in force, as `transfers` has them, with two columns more.

        `newer_draft` is the newest plan of the same pair and preset where that is another one, and
        `target_changed` tells that the structure is not as it was when the plan was last judged.
        """
        plans = self.transfers(in_force=True, structure=structure, kind=kind)
        newest = self.transfers(columns=["transfer_id", *PAIR, "status"], structure=structure, kind=kind)
        newest = newest[newest["status"] == "ok"].rename(columns={"transfer_id": "newer_draft"})
        plans = plans.merge(newest.drop(columns="status"), how="left", on=PAIR)
        same = (plans["newer_draft"] == plans["transfer_id"]) | (plans["purpose"] != "")
        plans["newer_draft"] = plans["newer_draft"].where(~same).fillna("")
        now, hashes = self.standing(), self.structures().set_index("structure_id")["sha256"]
        rows = plans.to_dict("records")
        plans["target_changed"] = [now.judged.get(unit_of(it)) != hashes.get(it["target_id"]) for it in rows]
        altered = custody.alterations(self, plans["transfer_id"].tolist(), now)
        plans["altered"] = plans["transfer_id"].map(altered).fillna("").astype(object)
        return plans

    def recalled(self, *, structure: str | None = None) -> pd.DataFrame:
        """Plans that were recalled and in whose place nobody released another."""
        now = self.standing()
        rows = [now.why[plan] for plan, state in now.state.items() if state == "recalled"]
        left = [row["transfer_id"] for row in rows if now.last[unit_of(row)] == row["decision_id"]]
        every = self.transfers(every=True, structure=structure, ids=sorted(left))
        return every[every["target_id"].isin(set(self.structures()["structure_id"]))].reset_index(drop=True)

    def foremost(self, columns: Sequence[str], ids: Sequence[str] | None = None) -> pd.DataFrame:
        """The newest plans, but the one in force in the place of the newest of its pair and preset.

        A plan in force whose demonstration is retired stays. `ids`: of these plans alone.
        """
        read = list(dict.fromkeys([*columns, *PAIR, "purpose"]))
        newest = self.transfers(columns=read, ids=ids)
        if not self.standing().in_force:  # else every plan would be read once more to find none
            return newest
        force = self.transfers(in_force=True, columns=read, ids=ids)
        every = pd.concat([force[force["purpose"] == ""], newest]).drop_duplicates(PAIR)
        return every.sort_values(PAIR, kind="stable", ignore_index=True)

    def review(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that somebody looked at a plan and found nothing against it; the name of the decision."""
        return self._decide(self._plan(transfer_id), "reviewed", by, note)

    def reject(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that a plan must not be flown; where it was in force, none is then."""
        return self._decide(self._plan(transfer_id), "rejected", by, note)

    def release(
        self, transfer_id: str, by: str, note: str = "", force: Sequence[str] = (), after: str | None = None
    ) -> str:
        """Put a plan in force for its pair until a person releases another; the name of the decision.

        Parameters
        ----------
        force : sequence of str
            Rules that are overruled: preset, verdict, rejected, recalled, changed.
        after : str, optional
            The last decision about the pair that the person knew of; none: the last there is now.

        Raises
        ------
        RefusedError
            If the plan has no path, is an experiment, breaks another rule, or somebody decided meanwhile.
        """
        row = self._plan(transfer_id)
        custody.check_releasable(self, row)
        now = self.standing()
        Roster(self.location).check_may_release(by.strip())
        forced = self._check_release(row, now.of(transfer_id), tuple(force))
        unit = unit_of(row)
        about = {
            "forced": "; ".join(forced),
            "target_sha256": self.newest("structures", row["target_id"])["sha256"],
        }
        about["after"] = now.last.get(unit, "") if after is None else after
        name = self._decide(row, "released", by, note, **about)
        if name in (again := self.standing()).void:
            fault = "somebody decided about this pair meanwhile"
            if there := again.in_force.get(unit):
                fault += f": {there['by']} released {there['transfer_id']}, which is in force"
            rule = "who releases knows what was decided before"
            raise RefusedError(f"release of {transfer_id}", fault, rule, "look again")
        return name

    def recall(self, row: Row, note: str, target_sha256: str, by: str) -> str:
        """Take a plan out of force whose changed structure it is not safe round; the decision's name."""
        return self._decide(row, "recalled", by, note, target_sha256=target_sha256)

    def rechecked(self, row: Row, note: str, target_sha256: str, by: str, supposed_sha256: str = "") -> str:
        """Keep that a plan was judged on its changed structure, with what is `supposed` of it, and stays."""
        judged = {"target_sha256": target_sha256, "supposed_sha256": supposed_sha256}
        return self._decide(row, "rechecked", by, note, **judged)

    def _plan(self, transfer_id: str) -> Row:
        row = self.transfer(transfer_id)
        if row["status"] != "ok" or not row["n_waypoints"]:
            fault = f"has no path: it is {row['status']}: {row['reason']}"
            raise RefusedError(f"plan {transfer_id}", fault, "what is decided about can be flown")
        return row

    def _check_release(self, row: Row, state: str, force: tuple[str, ...]) -> list[str]:
        """The rules that are broken and overruled, in words; refuses where others are broken."""
        if unknown := sorted(set(force) - set(RELEASE_RULES)):
            raise SettingsError(f"rule {unknown[0]!r}", "is unknown", f"one of {', '.join(RELEASE_RULES)}")
        what, purpose = f"release of {row['transfer_id']}", row["purpose"] or ""
        if purpose.startswith("experiment "):
            rule, remedy = "an experiment is never in force", "plan it without --experiment"
            raise RefusedError(what, f"it is of the {purpose}", rule, remedy)
        broken = {}
        if row["preset"] != "recommended" and not purpose:
            broken["preset"] = f"it is of preset {row['preset']}"
        if not row["flyable"]:
            broken["verdict"] = row["not_flyable"] or "it was planned by a version without a verdict"
        if state in ("rejected", "recalled"):
            broken[state] = f"it was {state}"
        if (was := row["target_sha256"]) and was != self.newest("structures", row["target_id"])["sha256"]:
            broken["changed"] = f"{row['target_id']} changed since it was planned"
        if left := [rule for rule in broken if rule not in force]:
            fault = "; ".join([broken[left[0]], *(f"{rule}: {broken[rule]}" for rule in left[1:])])
            raise RefusedError(what, fault, RELEASE_RULES[left[0]], f"or overrule it: --force {left[0]}")
        return [f"{rule}: {fault}" for rule, fault in broken.items()]

    def _decide(self, row: Row, state: str, by: str, note: str, **about: str) -> str:
        check_text("a decision", "note", note)
        who, name, plan = author(by, "a decision"), self.new_commit_id(), row["transfer_id"]
        of_plan = ("transfer_id", "demonstration_id", "target_id", "purpose")
        decision = {key: row[key] or "" for key in of_plan}
        decision |= {"decision_id": name, "state": state, "by": who, "note": note, **about}
        decision |= {"plan_sha256": row["waypoints_sha256"], "code_version": code_version()}
        decision["plan_row_sha256"] = custody.stored_plans(self, [plan])[1][plan]
        decision["signature"] = signature(Roster(self.location), decision)
        self.add_rows("decisions", [decision])
        return name

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

        On a structure or those of a kind, in a `state` of `STATES`, of a class, first added `since` a moment.
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
        return (rows[rows["finding_id"].isin(newest.index)] if history else newest).reset_index(drop=True)

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
        """Photos of flights that were registered, of one flight, of one structure, or all."""
        # Of what was said of a file, or of its name and bytes in another folder, the newest row counts.
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
