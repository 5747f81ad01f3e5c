"""What the documents say is run: the README's Python, its commands, its links."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from upplied.cli import main

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
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
    process = subprocess.run(
        [sys.executable, "script.py"], cwd=place, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    (place / "said.txt").write_text(process.stdout)
    return place


@pytest.mark.slow
def test_the_readme_python_says_what_it_claims(place):
    (code,) = blocks("python")
    claims = [
        line.split("# ")[1].strip() for line in code.splitlines() if line.startswith("print") and "# " in line
    ]
    output = (place / "said.txt").read_text()
    assert claims
    assert all(claim in output for claim in claims), output


def test_the_readme_python_is_ten_lines():
    (code,) = blocks("python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 10


@pytest.mark.ci
def test_the_readme_commands_work_in_their_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("UPPLIED_CATALOG", raising=False)
    word_lists = [shlex.split(line, comments=True)[1:] for line in commands("upplied")]
    assert len(word_lists) >= 8
    for words in word_lists:
        if words == ["studio"]:
            continue  # serves until it is stopped; web/test_studio.py does so
        assert main(words) == 0, words
    assert (tmp_path / "reports" / "index.html").is_file()
    assert (tmp_path / "reports" / "transfers.parquet").is_dir()


def test_the_readme_names_targets_that_make_has():
    makefile = (ROOT / "Makefile").read_text()
    for command in commands("make"):
        assert re.search(rf"^{command.split()[1]}:.*##", makefile, re.MULTILINE), command


def test_one_version_is_said_everywhere():
    versions = {
        name: re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)[1]
        for name, pattern in {
            "pyproject.toml": r'^version = "(.+)"',
            "upplied/__init__.py": r'^__version__ = "(.+)"',
            "CITATION.cff": r"^version: (.+)$",
            "CHANGELOG.md": r"^## (\d\S*)",
        }.items()
    }
    assert len(set(versions.values())) == 1, versions


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
        assert (document.parent / target).exists(), f"{document.name} links to {target}"


@pytest.mark.parametrize(
    "path", [ROOT / "Makefile", *ROOT.glob("requirements*.lock"), *DOCUMENTS], ids=lambda p: p.name
)
def test_no_place_of_one_machine_is_named(path):
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"/home/\w|/root/|/tmp/\w|pythonhosted|--index-url|--find-links", text)


def test_the_lock_pins_what_pyproject_asks_for():
    lock = (ROOT / "requirements.lock").read_text()
    pinned = dict(re.findall(r"^([a-z0-9-]+)==([^ ;\\]+)", lock, re.MULTILINE))
    requirements = [Requirement(text) for text in PROJECT["dependencies"] + EXTRAS["dev"]]
    while own := next((one for one in requirements if one.name == "upplied"), None):
        requirements.remove(own)
        requirements += [Requirement(text) for name in own.extras for text in EXTRAS[name]]
    assert len(requirements) > 40
    for one in requirements:
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        assert name in pinned, f"{name} is not locked: make lock"
        assert one.specifier.contains(pinned[name]), f"{name} {pinned[name]} is not {one.specifier}"
    assert "--hash=sha256:" in lock


def pins_of(name: str) -> dict[str, str]:
    """Each package of a lock, by its name and marker, with its version and hashes."""
    text = (ROOT / name).read_text().replace("\\\n", " ")
    return {re.sub(r"==[^ ;]+", "", line.split("--hash")[0]).strip(): line for line in text.splitlines()}


def installed(requirements: list[str]) -> set[str]:
    """What these bring on this machine, by the metadata of what is installed: all of it, and nothing else."""
    extras: set[tuple[str, str]] = set()
    waiting = [(Requirement(text), "") for text in requirements]
    while waiting:
        one, extra_of = waiting.pop()
        if one.marker and not one.marker.evaluate({"extra": extra_of}):
            continue
        name = canonicalize_name(one.name)
        if name == "upplied":
            waiting += [(Requirement(text), "") for extra in one.extras for text in EXTRAS[extra]]
            continue
        for extra in ({""} | one.extras) - {of for known, of in extras if known == name}:
            extras.add((name, extra))
            waiting += [(Requirement(text), extra) for text in metadata.requires(name) or ()]
    return {name for name, _ in extras}


def test_the_lock_that_runs_is_a_part_of_that_of_development_and_whole():
    """What Dockerfile and make quickstart install: the same files, all that is needed and no tool more."""
    runs, develops = pins_of("requirements-runtime.lock"), pins_of("requirements.lock")
    assert set(runs.items()) <= set(develops.items()), "made from another lock: make lock"
    pinned = [Requirement(re.sub(r" *\\$", "", line.split("--hash")[0])) for line in runs.values()]
    here = {canonicalize_name(one.name) for one in pinned if not one.marker or one.marker.evaluate()}
    assert here == installed(PROJECT["dependencies"] + EXTRAS["service"])
    assert not here & {"pytest", "mypy", "ruff", "playwright", "boto3", "evo"}


@pytest.mark.ci
def test_what_is_told_of_the_size_of_an_install_is_its_size():
    """From the lists of their files, which leave out the byte code that is written when they are unpacked."""
    size_gb = float(re.search(r"([\d.]+) GB unpacked into .venv", (ROOT / "Makefile").read_text())[1])
    names = installed(PROJECT["dependencies"] + EXTRAS["service"])
    size = sum(file.size or 0 for name in names for file in metadata.files(name) or ())
    assert 0.8 * size_gb < size / 1e9 < 1.1 * size_gb, size
    assert f"{size_gb:g} GB unpacked" in (ROOT / "README.md").read_text()


def test_every_room_of_tests_has_its_command_and_no_test_has_a_stop_watch():
    words = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rooms = {
        path.parent.name
        for path in (ROOT / "tests").glob("*/**/test_*.py")
        if path.parent.parent.name == "tests"
    }
    assert {"catalog", "fleet", "flows", "inputs"} <= rooms
    for room in rooms:
        assert re.search(rf'`make test ROOM="?[^"`]*\b{room}\b[^`]*`', words), room
    timed = re.compile(r"assert\b.*\b(perf_counter|process_time|monotonic)\(\) - ")
    for path in (ROOT / "tests").rglob("test_*.py"):
        assert not timed.search(path.read_text(encoding="utf-8")), f"{path.name} asserts a time"
