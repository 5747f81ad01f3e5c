"""Manifests: TOML and CSV say the same, every wrong key or value is named, no path leaves the folder."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.errors import InputError, UppliedError
from upplied.inputs.manifest_keys import KEYS
from upplied.inputs.manifests import StructureEntry, read_manifest

FULL = {
    "id": "a320-v1",
    "kind": "airplane",
    "path": "meshes/a320.ply",
    "units": "mm",
    "up": "y",
    "forward": "-z",
    "scale": 2.0,
    "local_origin": [1.0, 2.0, 3.0],
    "site": "hangar 4",
    "lat": 47.5,
    "lon": 8.5,
    "alt": 430.0,
    "datum": "amsl",
    "heading": 90.0,
    "nominal_length_m": 37.6,
    "nominal_width_m": 34.1,
    "nominal_height_m": 11.8,
    "ground_z": 0.0,
    "keep_out": [[[0, 0, 0], [1, 2, 3]]],
    "geofence": [[0, 0], [100, 0], [0, 100]],
    "rally": [[40, 40, 2.5]],
    "ceiling_z": 120.0,
    "landmarks": {"nose": [18.0, 0.0, 3.0]},
    "symmetric": True,
    "surface": "scanned",
    "surface_error_m": 0.15,
    "drop_hidden": True,
    "drop_outliers": False,
    "clip_ground": True,
    "notes": "as flown, 2024",
    "allow": ["odd-size"],
}
LEAST = {key: FULL[key] for key in ("id", "kind", "path", "units", "up", "forward")}


def toml(path: Path, *entries: dict) -> Path:
    lines = []
    for entry in entries:
        lines.append("[[structure]]")
        for key, value in entry.items():
            if isinstance(value, dict):
                value = "{" + ", ".join(f"{json.dumps(k)} = {json.dumps(v)}" for k, v in value.items()) + "}"
            else:
                value = json.dumps(value)
            lines.append(f"{key} = {value}")
    path.write_text("\n".join(lines))
    return path


def table(path: Path, *entries: dict) -> Path:
    keys = sorted({key for entry in entries for key in entry})
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(keys)
        for entry in entries:
            cells = [entry.get(key, "") for key in keys]
            writer.writerow([json.dumps(c) if isinstance(c, list | dict | bool) else c for c in cells])
    return path


def same(one: StructureEntry, other: StructureEntry) -> bool:
    return repr(one) == repr(other) and np.array_equal(
        one.surroundings.keep_out_m, other.surroundings.keep_out_m
    )


def test_every_key_is_understood_and_csv_says_what_toml_says(tmp_path: Path) -> None:
    assert set(FULL) == set(KEYS)
    (entry,) = read_manifest(toml(tmp_path / "structures.toml", FULL))
    (row,) = read_manifest(table(tmp_path / "structures.csv", FULL))
    assert same(entry, row)
    assert entry.path == tmp_path / "meshes" / "a320.ply"
    assert (entry.unit_m, entry.up, entry.forward, entry.scale) == (0.001, "y", "-z", 2.0)
    assert entry.placement is not None and entry.placement.datum == "amsl"
    assert entry.nominal_m == (37.6, 34.1, 11.8)
    assert entry.surroundings.keep_out_m.shape == (1, 2, 3)
    assert entry.surroundings.geofence_m.shape == (3, 2)
    assert entry.surroundings.rally_m.tolist() == [[40, 40, 2.5]]
    assert entry.landmarks == {"nose": (18.0, 0.0, 3.0)}
    assert entry.surface == "scanned" and entry.surface_error_m == 0.15
    assert entry.symmetric and entry.clip_ground and not entry.drop_outliers


def test_optional_keys_have_defaults_and_order_is_kept(tmp_path: Path) -> None:
    entries = read_manifest(table(tmp_path / "s.csv", LEAST, LEAST | {"id": "b", "units": "0.3048"}))
    assert [entry.structure_id for entry in entries] == ["a320-v1", "b"]
    assert entries[1].unit_m == 0.3048
    assert entries[0].placement is None and entries[0].surroundings.ground_z_m is None


def test_a_symmetric_structure_needs_no_forward_axis(tmp_path: Path) -> None:
    tower = {key: value for key, value in LEAST.items() if key != "forward"}
    with pytest.raises(InputError, match="forward"):
        read_manifest(toml(tmp_path / "a.toml", tower))
    (entry,) = read_manifest(toml(tmp_path / "b.toml", tower | {"symmetric": True}))
    assert entry.forward[-1] != entry.up[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": "../a"}, "A-Z a-z 0-9"),
        ({"id": 7}, "A-Z a-z 0-9"),
        ({"units": "furlong"}, "m, cm, mm, in, ft"),
        ({"units": -1}, "metres per unit"),
        ({"units": float("nan")}, "metres per unit"),
        ({"surface": "photographed"}, "one of drawn, scanned"),
        ({"surface_error_m": -0.1}, "from 0 to 10000"),
        ({"surface_error_m": float("nan")}, "from 0 to 10000"),
        ({"surface_error_m": float("inf")}, "from 0 to 10000"),
        ({"surface_error_m": "fine"}, "from 0 to 10000"),
        ({"up": "w"}, "x, y, z"),
        ({"up": "z", "forward": "-z"}, "two different axes"),
        ({"scale": 0}, "above 0"),
        ({"scale": True}, "above 0"),
        ({"lat": 47.0}, "no lon"),
        ({"lat": 91, "lon": 0, "alt": 0, "heading": 0}, "-90 to 90"),
        ({"datum": "sea"}, "ellipsoid, amsl"),
        ({"keep_out": [[[0, 0, 0], [1, 2, -3]]]}, "min before max"),
        ({"keep_out": [[0, 0, 0], [1, 2, 3]]}, "boxes"),
        ({"geofence": [[0, 0], [1, 1]]}, "at least 3"),
        ({"rally": [[1, 2]]}, "points"),
        ({"geofence": [[0, 0], [1, 1], [1]]}, "corners"),
        ({"landmarks": {"no se": [0, 0, 0]}}, "A-Z a-z 0-9"),
        ({"landmarks": {"nose": [0, 0]}}, "x, y, z"),
        ({"symmetric": "yes"}, "true or false"),
        ({"clip_ground": True}, "no ground_z"),
        ({"notes": "x" * 5000}, "4096"),
        ({"colour": "red"}, "known keys are id, kind, path"),
        ({"path": "../a.ply"}, "leaves the manifest's folder"),
        ({"path": "/etc/passwd"}, "leaves the manifest's folder"),
        ({"path": "a/../../a.ply"}, "leaves the manifest's folder"),
        ({"path": "a\0.ply"}, "text"),
    ],
)
def test_wrong_values_are_refused_with_the_rule(tmp_path: Path, change: dict, message: str) -> None:
    text = (
        toml(tmp_path / "s.toml", LEAST | change).read_text().replace("NaN", "nan").replace("Infinity", "inf")
    )
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(InputError, match=r"s\.toml") as caught:
        read_manifest(tmp_path / "s.toml")
    assert message in str(caught.value)


@pytest.mark.parametrize("key", ["id", "kind", "path", "units", "up", "forward"])
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    with pytest.raises(InputError, match=f"'{key}'"):
        read_manifest(toml(tmp_path / "s.toml", {k: v for k, v in LEAST.items() if k != key}))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("s.toml", "", "declares no structure"),
        ("s.toml", "[[structure]\n", "not TOML"),
        ("s.toml", "x = " + "[" * 5000, "not TOML"),
        ("s.toml", "[structure]\nid = 'a'\n", "two brackets"),
        ("s.toml", "[[structures]]\nid = 'a'\n", "unknown top-level key"),
        ("s.csv", "id,kind,id\n", "twice"),
        ("s.csv", "id,kind\na\n", "line 2"),
        ("s.csv", 'id,kind\n"a', "line 2"),
        ("s.csv", "", "declares no structure"),
        ("s.yaml", "a: 1", ".toml or a .csv"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name) as caught:
        read_manifest(tmp_path / name)
    assert message in str(caught.value)


def test_missing_and_undecodable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_manifest(tmp_path / "none.toml")
    (tmp_path / "s.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        read_manifest(tmp_path / "s.toml")


def test_ids_stand_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="twice"):
        read_manifest(toml(tmp_path / "s.toml", LEAST, LEAST))


def test_links_that_leave_the_folder_are_refused_unless_allowed(tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside" / "link").symlink_to(tmp_path / "outside")
    manifest = toml(tmp_path / "inside" / "s.toml", LEAST | {"path": "link/a.ply"})
    with pytest.raises(InputError, match="leaves"):
        read_manifest(manifest)
    assert read_manifest(manifest, allow_outside=True)[0].path.name == "a.ply"
    manifest = toml(tmp_path / "inside" / "s.toml", LEAST | {"path": str(tmp_path / "outside" / "b.ply")})
    assert read_manifest(manifest, allow_outside=True)[0].path == tmp_path / "outside" / "b.ply"


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_no_manifest_raises_anything_but_a_message(tmp_path_factory: pytest.TempPathFactory, data) -> None:
    folder = tmp_path_factory.mktemp("m")
    name = data.draw(st.sampled_from(["s.toml", "s.csv"]))
    path = (toml if name == "s.toml" else table)(folder / name, FULL, LEAST | {"id": "b"})
    text = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        text[at : at + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=6))
    path.write_bytes(bytes(text))
    try:
        entries = read_manifest(path)
    except UppliedError as error:
        assert name in str(error)
    else:
        assert all(isinstance(entry, StructureEntry) for entry in entries)
