"""What belongs to kinds and structures: settings and required zones, inherited and part of a plan's key.

A run's settings come over a structure's, those over its kind's, those over the preset (`recommended` alone);
of a set of zones the newest version counts.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from upplied.catalog.reading import Reading
from upplied.catalog.schema.plan_rows import tuples
from upplied.catalog.schema.rows import Row, json_text
from upplied.catalog.store.contents import labelled
from upplied.catalog.verbs.adding import Adding
from upplied.catalog.verbs.ordering import by_commit
from upplied.catalog.verbs.roster import author
from upplied.checks import check_id
from upplied.config import PRESETS, digest, settings_for
from upplied.errors import CatalogError, SettingsError

_NUMBERS = {"gsd_mm": (0.0, 1e5), "incidence_deg": (0.0, 90.0), "max_age_days": (0.0, 1e5)}  # above, up to
_LONGEST = 100_000  # letters of a place: what is painted has many balls
_MOST_LOOKS = _MOST_ZONES = 1000


class OwnSettings(Adding):
    """A catalog whose kinds and structures have settings and requirements; see `upplied.catalog.Catalog`."""

    def require(
        self, scope: str, owner: str, name: str, zones: Sequence[Mapping[str, Any]], by: str, note: str = ""
    ) -> int:
        """Say which zones of a structure, or of all of a kind, must be seen: the next version of a set.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner, name : str
            The kind, or the id of the structure; and the name of the set.
        zones : sequence of mapping
            Each with `zone` (its name), `where` (landmarks, part_0, "box X Y Z X Y Z", "ball X Y Z R", m,
            "labels HASH LABEL" of `add_labels`), `on`, and what is asked: `looks`, `gsd_mm`,
            `incidence_deg`, `max_age_days`. None takes the set back.
        """
        check_id(name, "name of requirements")
        about = self._owned(f"requirements {name}", scope, owner, by, note)
        kinds = dict(self.structures()[["structure_id", "kind"]].itertuples(index=False, name=None))
        kind = owner if scope == "kind" else kinds[owner]
        checked = [_zone(name, zone) for zone in zones]
        for zone in checked:
            if zone.get("on") and kinds.get(zone["on"]) != kind:
                what = f"requirements {name}, zone {zone['zone'][:60]}"
                raise SettingsError(what, f"is on {zone['on'][:60]!r}", f"a structure of kind {kind}")
        if len(zones) > _MOST_ZONES or len({zone["zone"] for zone in checked}) < len(zones):
            rule = f"{_MOST_ZONES} zones at most, each once"
            raise SettingsError(f"requirements {name}", "name a zone twice, or too many", rule)
        row = {"requirement_id": self.new_commit_id(), "name": name, **about}
        return self.add_rows("requirements", [{**row, "zones_json": json_text(checked) if zones else ""}])

    def _owned(self, what: str, scope: str, owner: str, by: str, note: str) -> Row:
        """What rows that belong to a kind or a structure say alike; one that is not there is refused."""
        who = author(by, what)
        known = set(self.structures()["kind" if scope == "kind" else "structure_id"])
        if scope not in ("kind", "structure") or owner not in known:
            some = ", ".join(sorted(known)[:8])
            raise CatalogError(f"{scope} {owner}", "is not in the catalog", f"such as {some}" if some else "")
        return {"scope": scope, "owner": owner, "by": who, "note": note}

    def add_labels(self, structure_id: str, labels: Sequence[str]) -> str:
        """Keep the label of each face of a structure's mesh, in their order; the HASH in zones of them."""
        return self.contents["labels"].put(labelled(self.structure(structure_id), labels))

    def requirements(self, every: bool = False, version: int | None = None) -> pd.DataFrame:
        """Sets of requirements until a `version` of their table, the newest of each or `every` one."""
        sets, owners = self.by_commit("requirements"), ["scope", "owner", "name"]
        if version is not None:
            sets = sets[sets["commit_version"] <= version].copy()
        sets["version"] = sets.groupby(owners).cumcount() + 1
        if not every:
            sets = sets.drop_duplicates(owners, keep="last")
            sets = sets[sets["zones_json"] != ""]
        return sets.reset_index(drop=True)

    def set(self, scope: str, owner: str, values: Mapping[str, Any], by: str, note: str = "") -> int:
        """Set settings of a kind or a structure, which its plans are then made with.

        `values` are by setting, as ``{"route.clearance_m": 3.0}``; None takes one back; else as `require`.
        """
        about = self._owned("a setting", scope, owner, by, note)
        commit, new = self.new_commit_id(), list[Row]()
        for setting, value in values.items():
            _check(setting, value)
            row = {**about, "setting_id": f"{commit}-{len(new)}", "setting": setting}
            row["value_json"] = "" if value is None else json_text(value)
            if setting == PRESET:
                row |= {"scope": APART[scope], "setting": f"{PRESET}.name"}
            new.append(row)
        return self.add_rows("settings", new)

    def declared_settings(self) -> pd.DataFrame:
        """Every setting that was declared for kinds and structures, in the order of commits."""
        return self.by_commit("settings")

    def settings_of(self, structure_id: str) -> pd.DataFrame:
        """Every setting that plans of a structure are made with, its value and where that comes from."""
        kind = str(self.newest("structures", structure_id)["kind"])
        known = declared(self)
        whole = settings_for(FLOWN, **changes_for(known, FLOWN, kind, structure_id, {}))
        settings = []
        for stage, values in {"": {PRESET: whole.preset}, **asdict(whole)}.items():
            for name, value in (values if isinstance(values, dict) else {}).items():
                source = f"preset {FLOWN}"
                for scope, owner in (("kind", kind), ("structure", structure_id)):
                    if name in known.get((scope, owner), {}).get(stage, {}):
                        source = f"{scope} {owner}"
                settings.append({"setting": f"{stage}.{name}".lstrip("."), "value": value, "from": source})
        if zones := Zones(self).of(kind, structure_id):
            row = next(row for row in settings if row["setting"] == ZONES)
            row["value"] = ", ".join(f"{zone['zone']} ({zone['set']} {zone['version']})" for zone in zones)
            row["from"] = ", ".join(dict.fromkeys(zone["asked_by"] for zone in zones))
        return pd.DataFrame(settings, columns=["setting", "value", "from"])


def _zone(name: str, zone: Mapping[str, Any]) -> Row:
    what = f"requirements {name}, zone {str(zone.get('zone', '(unnamed)'))[:60]}"
    allowed = ("zone", "where", "on", "looks", *_NUMBERS)
    if unknown := sorted(set(zone) - set(allowed)):
        raise SettingsError(what, f"has {unknown[0][:60]!r}", ", ".join(allowed))
    looks = zone.get("looks", 1)
    if not isinstance(looks, int) or isinstance(looks, bool) or not 1 <= looks <= _MOST_LOOKS:
        raise SettingsError(what, f"looks is {looks!r}", f"a whole number from 1 to {_MOST_LOOKS}")
    if not isinstance(zone.get("on", ""), str):
        raise SettingsError(what, f"is on {zone['on']!r}", "the id of a structure")
    for key in ("zone", "where"):
        if not isinstance(zone.get(key), str) or not 0 < len(zone[key].strip()) <= _LONGEST:
            raise SettingsError(what, f"has no {key}", f"a text of {_LONGEST} letters at most")
    for key, (low, high) in _NUMBERS.items():
        value = zone.get(key)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (number and low < value <= high):
            raise SettingsError(what, f"{key} is {value!r}", f"above {low:g} and up to {high:g}")
    return {key: value for key, value in zone.items() if value is not None}


class Zones:
    """The zones asked of structures, by kind and by themselves, until a version of the commits."""

    def __init__(self, catalog: OwnSettings, version: int | None = None) -> None:
        self._by_owner: dict[tuple[str, str], list[Row]] = {}
        for row in catalog.requirements(version=version).to_dict("records"):
            owner = f"{row['scope']} {row['owner']}"
            about = {"set": row["name"], "version": row["version"], "asked_by": owner}
            zones = [{**about, **zone} for zone in json.loads(row["zones_json"])]
            self._by_owner.setdefault((row["scope"], row["owner"]), []).extend(zones)
        table = catalog.structures()[["structure_id", "sha256"]] if self._by_owner else pd.DataFrame()
        self._sha256 = dict(table.itertuples(index=False)) if len(table) else {}

    def of(self, kind: str, structure_id: str) -> list[Row]:
        """Those of a structure, each with its set and version."""
        return [*self._by_owner.get(("kind", kind), []), *self._by_owner.get(("structure", structure_id), [])]

    def owned(self, structure_id: str) -> bool:
        """Whether the structure itself asks for any."""
        return ("structure", structure_id) in self._by_owner

    def named(self, kind: str, structure_id: str) -> str:
        """Hash of what a plan of the structure depends on by them; empty where nothing is asked."""
        parts, planned_by = [], ("on", "gsd_mm", "incidence_deg")
        for zone in self.of(kind, structure_id):
            parts.append(
                [zone["where"], self._sha256.get(zone.get("on", ""), ""), *map(zone.get, planned_by)]
            )
        return digest(sorted(parts, key=json_text)) if parts else ""


def zones_named(catalog: OwnSettings, kind: str, structure_id: str, name: str) -> list[Row]:
    """The zones of a structure of that name, as asked for now or before; none is an error."""
    table = catalog.tables["requirements"].read(None, ["commit_version"])
    for version in sorted(set(table["commit_version"].to_pylist()), reverse=True):
        zones = Zones(catalog, version)
        if zones.named(kind, structure_id) == name:
            return zones.of(kind, structure_id)
    what = f"that plans were based on ({name[:12]}) are not required any more"
    raise CatalogError(f"zones of {structure_id}", what, "", "plan it again: upplied transfer")


Changes = dict[str, dict[str, Any]]  # stage -> setting -> value
Owner = tuple[str, str]  # scope and owner

FLOWN = "recommended"  # the preset that they are for
ZONES = "required.zones"  # follows from requirements, and is not set
PRESET = "preset"  # which of them: it has no stage, and changes nothing within one
# Its rows stand apart: programs that know no such setting read the other scopes alone.
APART = {"kind": "preset of kind", "structure": "preset of structure"}
_SCOPES = {apart: scope for scope, apart in APART.items()}


def declared(catalog: Reading) -> dict[Owner, Changes]:
    """The settings of kinds and structures now."""
    owners: dict[Owner, Changes] = {}
    for row in by_commit(catalog.tables["settings"].read()):
        stage, _, name = row["setting"].rpartition(".")
        if row["scope"] in _SCOPES:
            stage, name = "", PRESET
        owner = str(_SCOPES.get(row["scope"], row["scope"])), str(row["owner"])
        values = owners.setdefault(owner, {}).setdefault(stage, {})
        values.pop(name, None)
        if row["value_json"]:
            values[name] = tuples(json.loads(row["value_json"]))
    return owners


def changes_for(
    known: Mapping[Owner, Changes], preset: str, kind: str, structure_id: str, of_run: Mapping[str, Any]
) -> Changes:
    """The changes to a preset for one structure: its kind's, over them its own, over them those of a run."""
    owners = [("kind", kind), ("structure", structure_id)] if preset == FLOWN else []
    changes: Changes = {}
    for part in [*(known.get(owner, {}) for owner in owners), of_run]:
        for stage, values in part.items():
            if stage:  # else the preset, which is the one that is flown
                changes[stage] = {**changes.get(stage, {}), **values}
    return changes


def _check(setting: str, value: Any) -> None:
    stage, dot, name = setting.partition(".")
    if setting == PRESET:
        if value is not None and value not in PRESETS:
            raise SettingsError(
                f"preset {str(value)[:60]!r}", "is unknown", f"{FLOWN}: the one that is flown"
            )
        if value not in (None, FLOWN):  # gate, release and pages count on it
            rule = f"what belongs to kinds and structures is of {FLOWN}, the one that is flown"
            remedy = f"plan it beside: upplied transfer --preset {value} --experiment NAME"
            raise SettingsError(f"preset {value}", "is for comparison, not for flight", rule, remedy)
    elif not dot:
        raise SettingsError(f"setting {setting!r}", "cannot be read", "STAGE.NAME")
    elif setting == ZONES:
        raise SettingsError(f"setting {ZONES}", "follows from requirements", "", "say: upplied require")
    elif value is not None or not hasattr(getattr(settings_for(FLOWN), stage, None), name):
        settings_for(FLOWN, **{stage: {name: tuples(value)}})  # which says what there is instead
