"""A plan from its row: what went in, so that it can be planned again and compared byte for byte."""

import json
from dataclasses import dataclass

import pyarrow.compute as pc

from upplied.catalog.database import Catalog
from upplied.catalog.schema.plan_rows import fields_in, transfer_row, tuples
from upplied.catalog.schema.rows import Row, same_named, table_of
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs import ordering
from upplied.config import Settings, settings_for
from upplied.errors import CatalogError
from upplied.records import Demonstration, Measures, Plan, Structure


@dataclass(frozen=True)
class Recipe:
    """Everything that one stored plan was made from."""

    row: Row  # of `transfers`
    demonstration: Demonstration
    source: Structure
    target: Structure
    settings: Settings
    siblings: tuple[Structure, ...] = ()  # that were asked for the parts of a scan

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why another result might come of it now, in words."""
        doubts = []
        if self.settings.sha256 != self.row["settings_sha256"]:
            doubts.append("settings were added to the program since; they have their defaults here")
        if len(self.siblings) < len(siblings_of(self.row)):
            doubts.append("siblings that labelled the parts of a scan are not in the catalog")
        return tuple(doubts)

    def differences(self, plan: Plan) -> list[str]:
        """Columns in which a plan made again differs from the stored one; none: the same bytes."""
        again = transfer_row(self.row["key"], plan, {"settings": self.settings})
        names = [
            "status", "reason", "n_viewpoints", "n_waypoints", "waypoints_sha256", "registration_json",
            "counterpart_summary", "parts_told_by", "warnings", *same_named(Measures, "transfers"),
        ]  # fmt: skip
        stored, other = table_of(TABLES["transfers"], [self.row, again]).to_pylist()
        return [name for name in names if stored[name] != other[name]]


def recipe(catalog: Catalog, transfer_id: str) -> Recipe:
    """What the plan of this name was made from: the versions of its inputs, and its settings.

    Raises
    ------
    CatalogError
        If an input of that hash is not in the catalog, or the settings are not known to this version.
    """
    row = catalog.transfer(transfer_id)
    flown = _version(catalog, "demonstrations", row["demonstration_id"], row["demonstration_sha256"])
    named = [(row[f"{role}_id"], row[f"{role}_sha256"]) for role in ("source", "target")]
    labeller, versions = row["parts_told_by"], siblings_of(row)
    named += [one for one in versions if one[0] == labeller or _versions(catalog, "structures", *one)]
    source, target, *siblings = (catalog.structure_of(_version(catalog, "structures", *one)) for one in named)
    settings = settings_of(row["settings_json"])
    return Recipe(row, catalog.demonstration_of(flown), source, target, settings, tuple(siblings))


def siblings_of(row: Row) -> list[tuple[str, str]]:
    """Id and hash of each structure that a plan was given to ask for the parts of a scan."""
    try:
        return [(str(name), str(sha256)) for name, sha256 in json.loads(row["siblings"] or "[]")]
    except (ValueError, TypeError) as error:
        what = f"plan {row['transfer_id']}"
        raise CatalogError(what, f"column siblings: {error}", "pairs of id and hash, as JSON") from None


def settings_of(text: str) -> Settings:
    """The settings of their JSON; what another version had and this one does not know is left out."""
    stages = tuples(json.loads(text))
    preset = settings_for(stages.pop("preset"))
    changes = fields_in(Settings, stages).items()
    known = {stage: fields_in(type(getattr(preset, stage)), values) for stage, values in changes}
    return settings_for(preset.preset, **known)


def _versions(catalog: Catalog, table: str, name: str, sha256: str) -> dict[str, Row]:
    where = (pc.field(TABLES[table].names[0]) == name) & (pc.field("sha256") == sha256)
    return ordering.newest_rows(catalog.tables[table], where)


def _version(catalog: Catalog, table: str, name: str, sha256: str) -> Row:
    if not (versions := _versions(catalog, table, name, sha256)):
        what, rule = f"{table[:-1]} {name}", "a plan is reproduced from the inputs it had"
        raise CatalogError(what, f"no version with hash {sha256[:12] or '(none)'} is in the catalog", rule)
    return versions[name]
