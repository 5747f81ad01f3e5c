"""Checks of everything that a catalog holds against what its rows say."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import reduce

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import ROW_SHA256, STEPS, TABLES, Column
from upplied.catalog.store.chain import breaks, encoded, rows_added
from upplied.catalog.store.contents import NAMED_CONTENTS
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.files import FileStore
from upplied.catalog.store.opening import HASHED_KEY
from upplied.catalog.verbs import custody
from upplied.catalog.verbs.custody import Fault, Folder, as_frame
from upplied.catalog.verbs.ordering import DERIVED
from upplied.catalog.verbs.recipes import settings_of
from upplied.checks import some
from upplied.errors import CatalogError, SettingsError, UppliedError

_ROWS = 4096  # that are looked at together, at least: a row of plans takes kilobytes
_LEAST_DIGITS = 12  # of a hash that was noted
#: Columns that name a row of another table: table, column, the other table.
_REFERENCES = (
    ("demonstrations", "structure_id", "structures"),
    ("transfers", "demonstration_id", "demonstrations"),
    ("transfers", "source_id", "structures"),
    ("transfers", "target_id", "structures"),
    *((table, "transfer_id", "transfers") for table in ("flights", "decisions", "overruled")),
    *((table, "target_id", "structures") for table in ("flight_photos", "findings")),
)
_COUNTS = ["n_vertices", "n_triangles"]
_SETTINGS = ["settings_json", "settings_sha256"]


def _held_columns(table: str) -> list[str]:
    """What is held of every row of a table at once, its name first; all else is looked at some at a time."""
    columns = [TABLES[table].names[0]]
    columns += [column for name, column, _ in _REFERENCES if name == table]
    columns += [column for _, name, column in NAMED_CONTENTS if name == table]
    for steps, owners in STEPS.items():
        columns += ["commit_id", f"n_{steps}", f"{steps}_sha256"] if owners == table else []
    columns += {"structures": _COUNTS, "transfers": _SETTINGS}.get(table, [])
    return list(dict.fromkeys(columns))


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be."""

    what: str
    found: str

    def __str__(self) -> str:
        return f"{self.what}: {self.found}"


def verify(catalog: Catalog, heads: Collection[str] = ()) -> list[Finding]:
    """Check every byte, row, count, reference and hash; an empty list means that all is well.

    Rows are those of every version, not of the current ones alone. Only what is committed counts:
    points that a stopped writer left behind are no finding.

    Parameters
    ----------
    catalog : Catalog
    heads : collection of str
        Hashes of rows as they were noted earlier (`custody.chain_heads`), or how these begin: a row that was
        taken away since is a finding.
    """
    catalog.identity.required()
    if short := [head for head in heads if len(head) < _LEAST_DIGITS]:
        raise SettingsError(f"head {short[0]!r}", "is too short", f"at least {_LEAST_DIGITS} digits")
    findings = list(_readable(custody.changed_files(catalog)))
    whole, unreadable, of_rows = dict[str, pa.Table](), list[Finding](), list[Finding]()
    for name in [table for table in TABLES if table not in STEPS]:
        try:
            whole[name], of_table = _every_row(catalog.tables[name], _held_columns(name))
            of_rows += of_table
        except CatalogError as error:
            unreadable.append(_unreadable(error))
    if unreadable:  # what refers to a table that cannot be read cannot be judged
        return [*findings, *unreadable]
    findings += [*of_rows, *_lost_heads(catalog, heads), *_readable(_not_as_released(catalog))]
    contents = {name: custody.stored_contents(store) for name, store in catalog.contents.items()}
    findings += [*_references(whole), *_meshes(whole, contents), *_contents(catalog, whole, contents)]
    findings += _settings(whole["transfers"].select(["transfer_id", *_SETTINGS]))
    for name in ("poses", "waypoints"):
        faults = custody.step_faults(catalog, name, whole[STEPS[name]])
        findings += _readable((f"{name} of {row}", wrong) for row, wrong in faults)
    return findings


def _not_as_released(catalog: Catalog) -> Iterator[Fault]:
    now = catalog.standing()
    plans = [row["transfer_id"] for row in now.in_force.values()]
    for plan, wrong in custody.alterations(catalog, plans, now).items():
        yield f"plan {plan}, which is in force", wrong


def _lost_heads(catalog: Catalog, heads: Collection[str]) -> Iterator[Finding]:
    chained = [table for table in catalog.tables.values() if table.declared.is_chained] if heads else []
    known = [sha256 for table in chained for sha256 in table.read(None, [ROW_SHA256])[0].to_pylist()]
    for head in heads:
        if not any((sha256 or "").startswith(head) for sha256 in known):
            yield Finding(f"head {head}", "no row has this hash: rows were taken away or changed")


def _every_row(table: StoredTable, columns: list[str]) -> tuple[pa.Table, list[Finding]]:
    """Some columns of all rows, each read once; and those that are wrong, changed, unhashed or lost."""
    added, delta = rows_added(FileStore(f"{table.uri}/_delta_log")), table.delta()
    since = "" if delta is None else delta.metadata().configuration.get(HASHED_KEY, "")
    key, name = table.declared.names[0], table.declared.name
    values, bare = Values(name, skipped=DERIVED if name == "transfers" else ()), list[str]()
    pieces, count = [encoded(table.declared.schema.empty_table().select(columns))], 0

    def parts() -> Iterator[pa.Table]:
        nonlocal count
        for rows in _together(table.batches(None)):
            count += len(rows)
            pieces.append(encoded(rows.select(columns)))
            values.look_at(rows)
            if since.isdigit():
                late = pc.greater_equal(rows["commit_version"], int(since))
                lacking = pc.equal(pc.coalesce(rows[ROW_SHA256], ""), "")
                bare.extend(rows.filter(pc.and_(late, lacking))[key].to_pylist())
            yield rows

    changed = [Finding(f"{name} {row}", wrong) for row, wrong in breaks(table.declared, parts())]
    unhashed = [Finding(f"{name} {row}", "has no hash: it was changed after it was written") for row in bare]
    findings = [*values.findings(), *changed, *unhashed]
    if count < added:
        findings.append(Finding(name, f"has {count} rows, and {added} were added: some were taken away"))
    return pa.concat_tables(pieces).unify_dictionaries(), findings


def _together(parts: Iterator[pa.Table]) -> Iterator[pa.Table]:
    """Rows of several small files at a time: a look at a hundred columns costs as much for one row."""
    waiting, count = list[pa.Table](), 0
    for part in filter(len, parts):
        waiting.append(part)
        count += len(part)
        if count >= _ROWS:
            yield pa.concat_tables(waiting)
            waiting, count = [], 0
    if waiting:
        yield pa.concat_tables(waiting)


def _unreadable(error: CatalogError) -> Finding:
    return Finding(error.what, f"{error.finding}; {error.remedy}" if error.remedy else error.finding)


def _readable(faults: Iterable[Fault]) -> Iterator[Finding]:
    """Faults as findings, as far as what they are of can be read, and where it cannot."""
    try:
        for what, wrong in faults:
            yield Finding(what, wrong)
    except CatalogError as error:
        yield _unreadable(error)


class Values:
    """Values of the rows of a table, some rows at a time, against the constraints of their columns."""

    def __init__(self, table: str, skipped: Collection[str] = ()) -> None:
        self._table = table
        self._columns = [column for column in TABLES[table].columns if column.name not in skipped]
        # By column: the first value that is not allowed, and the rows that have such.
        self._broken: dict[str, tuple[str, list[str]]] = {}

    def look_at(self, rows: pa.Table) -> None:
        """Take in some rows; columns that they lack are not judged."""
        for column in self._columns:
            bad = broken(column, rows[column.name]) if column.name in rows.column_names else None
            if bad is not None and pc.any(bad).as_py():
                first = str(rows[column.name].filter(bad)[0].as_py())
                names = self._broken.setdefault(column.name, (first, []))[1]
                names += rows.column(0).filter(bad).to_pylist()

    def findings(self) -> Iterator[Finding]:
        """What was broken, by column."""
        for column in self._columns:
            if column.name in self._broken:
                first, names = self._broken[column.name]
                fault = f"{first!r} is not {column.constraint}, in {some(names)}"
                yield Finding(f"{self._table}.{column.name}", fault)


def broken(column: Column, values: pa.ChunkedArray) -> pa.ChunkedArray | None:
    """Which values a column does not allow; None where it allows any."""
    masks = []
    if column.required or column.allowed:
        missing = values.is_null(nan_is_null=True)
        if pa.types.is_string(values.type):
            missing = pc.or_(missing, pc.equal(values.fill_null(""), ""))
        masks += [missing] if column.required else []
        if column.allowed:
            known = pc.is_in(values, pa.array(column.allowed, values.type))
            masks.append(pc.and_(pc.invert(known), pc.invert(missing)))
    if column.low is not None:
        masks.append(pc.less(values, column.low).fill_null(False))
    if column.high is not None:
        masks.append(pc.greater(values, column.high).fill_null(False))
    return reduce(pc.or_, masks) if masks else None


def _references(whole: dict[str, pa.Table]) -> Iterator[Finding]:
    """Names of structures, demonstrations and plans that are not there."""
    for table, column, to in _REFERENCES:
        known, named = _texts(whole[to].column(0)), _texts(whole[table][column])
        missing = sorted(named.filter(pc.invert(pc.is_in(named, known))).to_pylist())
        for name, owners in _owners(whole[table], column, missing).items():
            yield Finding(f"{table}.{column}", f"{name} is not in {to}; named by {some(owners)}")


def _texts(column: pa.ChunkedArray) -> pa.Array:
    texts = pc.unique(column)
    return texts.dictionary if pa.types.is_dictionary(texts.type) else texts


def _owners(rows: pa.Table, column: str, values: list[str], name: int | str = 0) -> dict[str, list[str]]:
    own = rows.filter(pc.is_in(rows[column].cast(pa.string()), pa.array(values, pa.string())))
    owners: dict[str, list[str]] = {value: [] for value in values}
    for value, owner in zip(own[column].to_pylist(), own[name].to_pylist(), strict=True):
        owners[value].append(owner)
    return owners


def _meshes(whole: dict[str, pa.Table], contents: dict[str, Folder]) -> Iterator[Finding]:
    """Counts of structures that are not those of their meshes."""
    for sha256, rows in whole["structures"].to_pandas().groupby("mesh_sha256"):
        counts = contents["meshes"].sizes.get(sha256)
        wrong = rows[rows[_COUNTS].ne([*counts]).any(axis=1)]["structure_id"] if counts else ()
        if len(wrong):
            yield Finding(f"mesh {sha256}", f"has {counts} parts, other than stated of {some(wrong)}")


def _contents(catalog: Catalog, whole: dict[str, pa.Table], contents: dict[str, Folder]) -> Iterator[Finding]:
    """What is kept by its content and is damaged or not there, and whose it is."""
    place, named = catalog.location.rstrip("/"), set()
    for name, table, column in NAMED_CONTENTS:
        rows = whole[table]
        hashes = filter(None, _texts(rows[column]).to_pylist())
        faults = {sha256: custody.fault_of(contents, name, sha256) for sha256 in hashes}
        wrong = {sha256: fault for sha256, fault in faults.items() if fault[1]}
        owner = "structure_id" if table == "structures" else "transfer_id"
        for sha256, owners in _owners(rows, column, list(wrong), owner).items():
            file, words = wrong[sha256]
            named.add(file)
            whose = "the mesh of" if name == "meshes" else "of"
            yield Finding(f"{place}/{file}", f"{words}; {whose} {some(owners)}")
    for name, folder in contents.items():
        for sha256, words in folder.faults.items():
            if words and (file := f"{name}/{sha256}.parquet") not in named:
                yield Finding(f"{place}/{file}", words)


def _settings(transfers: pa.Table) -> Iterator[Finding]:
    """Settings that do not match their hash, where this program knows all of them."""
    for (text, sha256), rows in as_frame(transfers).groupby(_SETTINGS, observed=True):
        try:
            settings = settings_of(text)
            wrong = "" if settings.sha256 == sha256 or settings.text != text else "do not match it"
        except (UppliedError, ValueError) as error:
            wrong = f"cannot be read: {error}"
        if wrong:
            yield Finding(f"settings {sha256[:12]}", f"{wrong}; of {some(rows['transfer_id'])}")
