"""What the documents say is run: the README's Python, its commands, its links."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("[!.]*/README.md"), *ROOT.glob("docs/*.md")])
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def commands(first_word: str) -> list[str]:
    lines = [line.split("  #")[0].strip() for block in blocks("bash") for line in block.splitlines()]
    return [line for line in lines if line.split()[:1] == [first_word]]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder in which the README's Python was run."""
    place = tmp_path_factory.mktemp("readme")
    (code,) = blocks("python")
    (place / "script.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=place, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (place / "said.txt").write_text(done.stdout)
    return place


@pytest.mark.slow
@pytest.mark.ci
def test_the_readme_python_says_what_it_claims(place):
    (code,) = blocks("python")
    claims = [
        line.split("# ")[1].strip() for line in code.splitlines() if line.startswith("print") and "# " in line
    ]
    said = (place / "said.txt").read_text()
    assert claims
    assert all(claim in said for claim in claims), said


def test_the_readme_python_is_ten_lines():
    (code,) = blocks("python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 10


@pytest.mark.slow
@pytest.mark.ci
def test_the_readme_commands_work_in_their_order(place):
    upplied = f"{sys.executable} -c 'import sys; from upplied.cli import main; sys.exit(main())'"
    told = commands("upplied")
    assert len(told) >= 8
    script = "\n".join(["set -e", *(line.replace("upplied", upplied, 1) for line in told)])
    done = subprocess.run(
        ["bash", "-c", script], cwd=place, capture_output=True, text=True, check=False, env=os.environ
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (place / "reports" / "index.html").is_file()
    assert (place / "reports" / "transfers.parquet").is_dir()


def test_the_readme_names_targets_that_make_has():
    makefile = (ROOT / "Makefile").read_text()
    for command in commands("make"):
        assert re.search(rf"^{command.split()[1]}:.*##", makefile, re.MULTILINE), command


def test_one_version_is_said_everywhere():
    said = {
        name: re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)[1]
        for name, pattern in {
            "pyproject.toml": r'^version = "(.+)"',
            "upplied/__init__.py": r'^__version__ = "(.+)"',
            "CITATION.cff": r"^version: (.+)$",
            "CHANGELOG.md": r"^## (\d\S*)",
        }.items()
    }
    assert len(set(said.values())) == 1, said


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
        assert (document.parent / target).exists(), f"{document.name} links to {target}"


@pytest.mark.parametrize(
    "path", [ROOT / "Makefile", ROOT / "requirements.lock", *DOCUMENTS], ids=lambda p: p.name
)
def test_no_place_of_one_machine_is_named(path):
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"/home/\w|/root/|/tmp/\w|pythonhosted|--index-url|--find-links", text)


def test_the_lock_pins_what_pyproject_asks_for():
    import tomllib

    from packaging.requirements import Requirement

    lock = (ROOT / "requirements.lock").read_text()
    pinned = dict(re.findall(r"^([a-z0-9-]+)==([^ ;\\]+)", lock, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [Requirement(text) for text in project["dependencies"] + extras["dev"]]
    for own in [one for one in wanted if one.name == "upplied"]:
        wanted.remove(own)
        wanted += [Requirement(text) for name in own.extras for text in extras[name]]
    assert len(wanted) > 40
    for one in wanted:
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        assert name in pinned, f"{name} is not locked: make lock"
        assert one.specifier.contains(pinned[name]), f"{name} {pinned[name]} is not {one.specifier}"
    assert "--hash=sha256:" in lock
