"""Settings that belong to kinds and structures: set once, inherited, and part of a plan's key.

A run's come over a structure's, those over its kind's, those over the preset; only for `recommended`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pandas as pd

from upplied.catalog.schema.plan_rows import tuples
from upplied.catalog.schema.rows import Row, json_text, rows_of
from upplied.catalog.verbs.required import Requiring, Zones
from upplied.config import PRESETS, settings_for
from upplied.errors import SettingsError

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

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
    table = rows_of(catalog.tables["settings"].read())
    for row in sorted(table, key=lambda row: row["commit_version"]):
        stage, _, name = row["setting"].rpartition(".")
        scope = str(row["scope"])
        if scope in _SCOPES:
            stage, name = "", PRESET
        owner = _SCOPES.get(scope, scope), str(row["owner"])
        values = owners.setdefault(owner, {}).setdefault(stage, {})
        values.pop(name, None)
        if row["value_json"]:
            values[name] = tuples(json.loads(row["value_json"]))
    return owners


def changes_for(
    known: Mapping[Owner, Changes], preset: str, kind: str, structure_id: str, of_run: Mapping[str, Any]
) -> Changes:
    """The changes to a preset for one structure: its kind's, over them its own, over them those of a run."""
    parts = [known.get(("kind", kind), {}), known.get(("structure", structure_id), {})]
    changes: Changes = {}
    for part in [*(parts if preset == FLOWN else []), of_run]:
        for stage, values in part.items():
            if stage:  # else the preset, which is the one that is flown
                changes[stage] = {**changes.get(stage, {}), **values}
    return changes


class OwnSettings(Requiring):
    """A catalog whose kinds and structures have settings; see `upplied.catalog.Catalog`."""

    def set(self, scope: str, owner: str, values: Mapping[str, Any], by: str, note: str = "") -> int:
        """Set settings of a kind or a structure, which its plans are then made with.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner : str
            The kind, or the id of the structure.
        values : mapping
            Setting to value, as ``{"route.clearance_m": 3.0}``; None takes it back.
        by : str
            Who sets them.
        note : str
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


def _check(setting: str, value: Any) -> None:
    """Refuse a setting that there is not, or a value that it does not take."""
    stage, dot, name = setting.partition(".")
    if setting == PRESET:
        if value is not None and value not in PRESETS:
            rule = f"{FLOWN}: the one that is flown"
            raise SettingsError(f"preset {str(value)[:60]!r}", "is unknown", rule)
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
