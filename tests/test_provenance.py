"""What made a result is part of its key, and is named where a result differs."""

from dataclasses import replace

import pytest

from upplied import __version__, provenance
from upplied.config import settings_for
from upplied.planning.correspondence.memo import content_key
from upplied.planning.plan import METHOD_VERSION, transfer_key
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def job():
    (cube,) = [one for one in sample_structures() if one.structure_id == "cube-v1"]
    return replace(fly(cube, "sides"), sha256="f"), replace(cube, sha256="c"), cube, settings_for("paper")


@pytest.mark.parametrize("fact", ["sources_sha256", "libraries"])
def test_other_sources_and_libraries_give_other_keys(job, monkeypatch, fact):
    """Planning changed after the last raise of the method's version, and nothing was planned again."""
    before = transfer_key(*job), content_key("clouds", "x")
    assert before == (transfer_key(*job), content_key("clouds", "x"))
    monkeypatch.setattr(provenance, fact, lambda: "another")
    assert transfer_key(*job) != before[0] and content_key("clouds", "x") != before[1]


def test_another_machine_plans_under_the_same_key(job, monkeypatch):
    before = transfer_key(*job)
    monkeypatch.setattr(provenance, "machine", lambda: "another")
    monkeypatch.setattr(provenance, "code_version", lambda: "another")
    assert transfer_key(*job) == before


def test_every_source_of_planning_counts(monkeypatch, tmp_path):
    for name in (
        "planning/deep",
        "records",
        "geometry",
        "checks.py",
        "threads.py",
    ):
        path = tmp_path / name
        if path.suffix:
            path.write_text("x = 1\n")
        else:
            path.mkdir(parents=True)
    for name in ("planning/deep/a.py", "records/b.py", "geometry/c.py"):
        (tmp_path / name).write_text("x = 1\n")
    monkeypatch.setattr(provenance, "_PACKAGE", tmp_path)
    sha256 = provenance.sources_sha256.__wrapped__
    first = sha256()
    (tmp_path / "planning" / "deep" / "a.py").write_bytes(b"x = 1\r\n")
    assert sha256() == first  # as another system writes its lines
    seen = {first}
    for path in sorted(tmp_path.rglob("*.py")):
        path.write_text("x = 2\n")
        seen.add(sha256())
    (tmp_path / "planning" / "b.py").write_text("")
    seen.add(sha256())
    assert len(seen) == 7


def test_the_libraries_that_results_depend_on_are_named():
    named = dict(item.rsplit(" ", 1) for item in provenance.libraries().split(", "))
    assert set(named) == {"numpy", "scipy", "numba", "open3d"}
    assert provenance.machine()


def test_a_checkout_names_its_commit(tmp_path):
    git = tmp_path / ".git"
    (git / "refs" / "heads").mkdir(parents=True)
    (git / "HEAD").write_text("ref: refs/heads/main\n")
    assert provenance._commit(git) == ""
    (git / "packed-refs").write_text("# pack-refs with: peeled\n" + "1" * 40 + " refs/heads/main\n")
    assert provenance._commit(git) == "1" * 40
    (git / "refs" / "heads" / "main").write_text("2" * 40 + "\n")
    assert provenance._commit(git) == "2" * 40
    (git / "HEAD").write_text("3" * 40 + "\n")
    assert provenance._commit(git) == "3" * 40
    assert provenance._commit(tmp_path / "nowhere") == ""
    assert provenance.code_version().startswith(__version__)


def test_causes_are_named():
    now = {"method_version": METHOD_VERSION, **provenance.recorded()}
    assert provenance.causes(now, METHOD_VERSION) == []
    then = {**now, "libraries": now["libraries"].replace("numpy ", "numpy 0."), "machine": "z80"}
    library, machine = provenance.causes(then, METHOD_VERSION)
    assert library.startswith("numpy 0.") and " became " in library and "z80 then" in machine
    (sources,) = provenance.causes({**now, "sources_sha256": "x", "code_version": "0.0.9"}, METHOD_VERSION)
    assert "0.0.9 then" in sources
    old = provenance.causes({"method_version": "3"}, METHOD_VERSION)  # of a catalog before these columns
    assert f"method 3 became {METHOD_VERSION}" in old and len(old) == 3
