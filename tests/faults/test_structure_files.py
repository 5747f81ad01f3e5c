"""Files of wrong structures: each rule is broken, named and overruled, from the mesh to the page."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

import bad_meshes
import mesh_files

from upplied.errors import InputError
from upplied.inputs.manifests import read_manifest
from upplied.inputs.meshes import read_structure
from upplied.inputs.rules import RULES, StructureSettings, from_json

BOUNDS = StructureSettings()


ALONE = list(bad_meshes.odd_alone())


@pytest.mark.parametrize("odd", ALONE, ids=lambda odd: odd.rule)
def test_each_rule_is_broken_by_a_file_and_overruled_by_its_name(tmp_path: Path, odd: bad_meshes.Odd) -> None:
    entry = bad_meshes.entry_of(odd, tmp_path, mesh_files.write(odd.vertices, odd.triangles, odd.suffix))
    if RULES[odd.rule].severity == "refuse":
        with pytest.raises(InputError, match=f"--allow {odd.rule}"):
            read_structure(entry)
    else:
        verdicts = from_json(read_structure(entry).verdicts_json)
        assert [one.rule for one in verdicts] == [odd.rule] and not verdicts[0].overruled
        with pytest.raises(InputError, match=f"--allow {odd.rule}"):
            read_structure(replace(entry, strict=True))
    verdicts_allowed = from_json(read_structure(replace(entry, allow=(odd.rule,), strict=True)).verdicts_json)
    assert {one.rule for one in verdicts_allowed if one.overruled} == {odd.rule}


def test_every_rule_has_a_test_here() -> None:
    among_others = {"size", "units", "up-axis", "odd-up-axis", "forward-axis", "odd-size", "kind"}
    among_others |= {"size-unconfirmed"}
    among_others |= {"floating", "cut-off"}  # tests/inputs/test_reader_bounds.py
    among_others |= {"looks-scanned"}  # tests/test_reconstruction.py
    assert {odd.rule for odd in ALONE} | among_others == set(RULES)
    assert all(rule.reason and rule.remedy for rule in RULES.values())
    assert all(hasattr(BOUNDS, bound) for rule in RULES.values() for bound in rule.bounds)


def test_a_manifest_overrules_by_name_and_knows_the_rules(tmp_path: Path) -> None:
    head = '[[structure]]\nid = "a"\nkind = "b"\npath = "a.ply"\nunits = "m"\nup = "z"\nforward = "x"\n'
    path = tmp_path / "structures.toml"
    path.write_text(head + 'allow = ["odd-size", "kind"]\n')
    assert read_manifest(path)[0].allow == ("kind", "odd-size")
    path.write_text(head + 'allow = ["everything"]\n')
    with pytest.raises(InputError, match="names of rules"):
        read_manifest(path)
