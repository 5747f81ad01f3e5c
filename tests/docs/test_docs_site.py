"""The documentation: the site is built from nothing but this tree, its examples run, its figures exist."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip(
    "mkdocs", reason="the documentation's generator is not installed: pip install -e '.[dev]'"
)

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
# What others prove, too: a fleet in README's Python; missions, wind, settings and pictures in commands.
LONG = ("03_a_catalog", "04_a_mission_file", "05_flown_in_wind", "06_other_settings", "07_pictures")
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, built strictly: a link that leads nowhere is an error."""
    goal = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(goal)]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=quiet)
    assert process.returncode == 0, process.stdout + process.stderr
    return goal


@pytest.mark.slow
def test_pages_fetch_nothing_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 25
    for page in pages:
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r"<(?:script|img|iframe)[^>]*\ssrc=[\"']?(https?:[^\"'\s>]+)", text)
        fetched += re.findall(
            r"<link(?=[^>]*rel=[\"']?(?:stylesheet|preconnect))[^>]*href=[\"']?(https?:[^\"'\s>]+)", text
        )
        assert not fetched, f"{page.name} fetches {fetched}"


@pytest.mark.ci
def test_every_picture_of_a_page_is_there(site):
    for page in site.rglob("*.html"):
        for source in re.findall(r"<img[^>]*\ssrc=[\"']?([^\"'\s>]+)", page.read_text(encoding="utf-8")):
            if not source.startswith("data:"):
                assert (page.parent / source).is_file(), f"{page.name} shows {source}"


@pytest.mark.ci
def test_the_reference_tells_of_every_public_name_and_of_the_way_of_a_plan(site):
    import upplied

    public = (site / "reference" / "public.html").read_text(encoding="utf-8")
    assert all(f"<code>{name}</code>" in public for name in upplied._PUBLIC)
    tree = (site / "reference" / "house.html").read_text(encoding="utf-8")
    way = [
        f"<code>{call}</code>"
        for call in ("siblings.study", "carried.carry", "complete.propose", "evaluate.judge")
    ]
    assert [tree.count(call) for call in way] == [1] * 4
    assert sorted(way, key=tree.index) == way


@pytest.mark.ci
def test_the_reference_tells_of_every_setting_key_and_column(site):
    from upplied.catalog.schema.tables import TABLES
    from upplied.config import settings_for
    from upplied.inputs.manifest_keys import KEYS

    settings = (site / "reference" / "settings.html").read_text(encoding="utf-8")
    for stage, values in vars(settings_for("paper")).items():
        for name in vars(values) if stage not in ("preset", "sha256") else ():
            assert f"{stage}.{name}" in settings
    rows = re.findall(r"<tr>\s*<td><code>\w+\.\w+</code></td>.*?</td>\s*<td>(.*?)<em>", settings, re.DOTALL)
    assert len(rows) > 30 and all(len(meaning.strip()) > 7 for meaning in rows)
    manifest = (site / "reference" / "manifest.html").read_text(encoding="utf-8")
    assert all(f"<code>{key}</code>" in manifest for key in KEYS)
    dictionary = (site / "reference" / "dictionary.html").read_text(encoding="utf-8")
    for table in TABLES.values():
        assert all(f"<code>{column.name}</code>" in dictionary for column in table.columns)


@pytest.mark.ci
def test_the_reference_tells_of_every_command(site):
    from upplied.cli import app

    text = (site / "reference" / "command.html").read_text(encoding="utf-8")
    for name in app:
        if not name.startswith("-"):
            assert f"upplied {name}" in text


@pytest.mark.ci
def test_the_reference_tells_what_planning_returns(site):
    planning = (site / "reference" / "planning.html").read_text(encoding="utf-8")
    assert 'id="upplied.planning.plan.plan_transfer"' in planning
    assert "Plan the demonstrated inspection of one structure on another" in planning


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in LONG else pytest.mark.ci)
        for path in EXAMPLES
    ],
)
def test_examples_run(example, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip() or list(tmp_path.iterdir()), "an example shows what came of it"


@pytest.mark.ci
def test_the_gallery_shows_every_example_in_order(site):
    shown = re.findall(r"examples/(\d\d_\w+\.py)", (site / "examples.html").read_text(encoding="utf-8"))
    assert shown == [path.name for path in EXAMPLES]


@pytest.mark.slow
def test_the_tutorial_leads_to_a_mission_file(tmp_path):
    def blocks(language: str) -> list[str]:
        return re.findall(rf"```{language}\n(.*?)```", TUTORIAL, re.DOTALL)

    (code,) = blocks("python")
    (tmp_path / "made.py").write_text(code, encoding="utf-8")
    script = "\n".join(["set -e", "python made.py", *blocks("bash")])
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    process = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": path},
    )
    assert process.returncode == 0, process.stdout + process.stderr
    assert (tmp_path / "tank-2.plan").stat().st_size > 1000
    assert (tmp_path / "reports" / "index.html").is_file()
