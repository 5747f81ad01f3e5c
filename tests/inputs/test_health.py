"""Health reports: facts a person can check, for declared entries and for files alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mesh_files
import numpy as np
import pytest
import trimesh

from upplied.errors import InputError
from upplied.geometry.reconstruction import held
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.outputs.health import health_report


def test_a_file_alone_is_reported_with_what_was_assumed(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(mesh_files.write(*mesh_files.shape(), "stl"))
    report = health_report(path)
    text = report.text
    assert report.size_m == pytest.approx((4.0, 2.0, 4.0)) and report.format == "stl"
    assert "4.00 x 2.00 x 4.00 m" in text and "metres assumed" in text and "declare `up`" in text
    assert "m (assumed); up z, forward x" in text
    assert "24 triangles, 16 vertices, 2 connected parts" in text and "watertight  yes" in text
    assert "56 vertices welded" in text


def test_units_and_axes_of_the_file_are_used_and_named(tmp_path: Path) -> None:
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.write(*mesh_files.shape(), "glb"))
    report = health_report(str(path))
    assert report.size_m == pytest.approx((4.0, 4.0, 2.0))  # the file says that y is up, so z is forward
    assert "m (file); up y, forward z" in report.text and "metres assumed" not in report.text


def test_an_entry_is_reported_as_it_would_be_ingested(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    vertices, triangles = mesh_files.shape()
    path.write_bytes(mesh_files.write(vertices * 1000, triangles, "obj"))
    entry = StructureEntry("part", "box", path, 0.001)
    report = health_report(entry)
    assert np.array_equal(report.structure.vertices, read_structure(entry).vertices)
    assert "mm (manifest)" in report.text and not report.warnings and not report.problems


@pytest.mark.ci
def test_the_report_says_how_far_the_surface_is_known(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_bytes(mesh_files.write(*mesh_files.shape(), "obj"))
    entry = StructureEntry("part", "box", path, 1.0)
    assert "accuracy    0.0 mm, by the roughness of a drawn mesh" in health_report(entry).text
    drawn = replace(entry, surface="drawn")
    assert "accuracy    exact (declared as drawn)" in health_report(drawn).text
    assert "accuracy    0.10 m, declared" in health_report(replace(entry, surface_error_m=0.1)).text
    scan = trimesh.creation.icosphere(5, 6.0)
    scan.vertices += np.random.default_rng(0).normal(0, 0.03, scan.vertices.shape)
    path.write_bytes(mesh_files.write(np.asarray(scan.vertices), np.asarray(scan.faces), "obj"))
    assert "it looks like a reconstruction of a scan (then declare" in health_report(entry).text
    assert "mm, by the roughness" in health_report(entry).text
    entry = replace(entry, surface="scanned")
    assert "looks like a reconstruction" not in health_report(entry).text
    of = held(read_structure(entry))
    error_m, thin_m = of.error_m, of.thin_m
    sentence = f"{error_m:.2f} m, inferred for a scan; objects thinner than {thin_m:.2f} m may be missing"
    assert sentence in health_report(entry).text
    assert "may be missing" not in health_report(replace(entry, surface_error_m=0.1)).text


def test_a_size_off_the_nominal_one_is_reported_not_raised(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_bytes(mesh_files.write(*mesh_files.shape(), "obj"))
    entry = StructureEntry("part", "box", path, 1.0, nominal_m=(40.0, None, None))
    report = health_report(entry)
    assert len(report.problems) == 1 and "refused" in report.text and "-90 %" in report.text
    with pytest.raises(InputError):
        read_structure(entry)


def test_open_inverted_and_hidden_things_are_named(tmp_path: Path) -> None:
    shell = trimesh.creation.box((6, 6, 6))
    shell.invert()
    both = trimesh.util.concatenate([shell, trimesh.creation.box((1, 1, 1))])
    path = tmp_path / "part.off"
    path.write_bytes(mesh_files.write(both.vertices, both.faces, "off"))
    text = health_report(StructureEntry("part", "box", path, 1.0)).text
    assert "1 hidden inside" in text and "12 triangles turned" in text and "drop_hidden" in text
    path.write_bytes(mesh_files.write(shell.vertices, shell.faces[2:], "off"))
    assert "no: 4 open edges" in health_report(path).text


def test_a_cloud_is_called_one(tmp_path: Path) -> None:
    path = tmp_path / "part.pcd"
    path.write_bytes(mesh_files.pcd(np.random.default_rng(0).random((200, 3)) * 9))
    text = health_report(path).text
    assert "200 points" in text and "triangles" not in text.replace("triangulated", "")


@pytest.mark.parametrize(
    ("name", "warned"), [("Ship_Wake", True), ("light_spot.001", True), ("Lighthouse", False)]
)
def test_parts_named_like_effects_are_pointed_at(tmp_path: Path, name: str, warned: bool) -> None:
    path = tmp_path / "part.obj"
    text = mesh_files.write(*mesh_files.shape(), "obj").decode()
    path.write_text(text.replace("\nf ", f"\no {name}\nf ", 1))
    assert ("sound like effects" in health_report(path).text) == warned
