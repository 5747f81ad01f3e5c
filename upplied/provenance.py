"""Which program made a result: digest of the planning sources, versions of libraries, commit, machine.

A version that a person raises is forgotten; what a result follows from is not. So the sources of the
method and the versions of the libraries that it computes with are part of every key.
"""

import hashlib
import platform
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

_PACKAGE = Path(__file__).parent
#: What a plan is computed by; a change of any line of it, a comment too, counts as a change of the method.
_SOURCES = ("planning", "checks.py", "geometry", "records", "threads.py")
#: Distributions whose results a plan depends on; of Open3D, whichever is installed.
_LIBRARIES = ("numpy", "scipy", "numba", "open3d", "open3d-cpu")


@cache
def sources_sha256() -> str:
    """Digest (hex, 64 digits) of the files that planning consists of."""
    content = hashlib.sha256()
    for name in _SOURCES:
        place = _PACKAGE / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            text = path.read_bytes().replace(b"\r\n", b"\n")
            content.update(f"{path.relative_to(_PACKAGE).as_posix()} {len(text)}\n".encode() + text)
    return content.hexdigest()


@cache
def libraries() -> str:
    """Names and versions of the libraries that results depend on, e.g. ``numba 0.61.2, numpy 2.2.6``."""
    versions = {}
    for name in _LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            versions[name.removesuffix("-cpu")] = metadata.version(name)
    return ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))


@cache
def machine() -> str:
    """Processor and the kernels that linear algebra chose for it: they differ in the last digit.

    It is recorded beside a plan and no part of its key, or a fleet of unlike machines would plan for ever.
    """
    import scipy.linalg  # noqa: F401  # so that its library is loaded, whoever asks
    from threadpoolctl import threadpool_info

    kernels = {
        f"{pool['internal_api']} {pool['version']} {pool.get('architecture', '')}".strip()
        for pool in threadpool_info()
        if pool["user_api"] == "blas" and ("numpy" in pool["filepath"] or "scipy" in pool["filepath"])
    }
    return ", ".join([platform.machine(), *sorted(kernels)])


@cache
def code_version() -> str:
    """The version of the program, and the commit where it runs from a checkout: ``0.1.0+g1a2b3c4d5e6f``."""
    from upplied import __version__

    commit = _commit(_PACKAGE.parent / ".git")
    return f"{__version__}+g{commit[:12]}" if commit else __version__


def method() -> dict[str, str]:
    return {"sources": sources_sha256(), "libraries": libraries()}


def recorded() -> dict[str, str]:
    """What is kept of the program beside a plan, by the columns of `transfers`."""
    known = {"code_version": code_version(), "sources_sha256": sources_sha256()}
    return known | {"libraries": libraries(), "machine": machine()}


def causes(row: Mapping[str, object], method_version: str) -> list[str]:
    """Why this program may plan otherwise than the one that wrote a row of `transfers`, in words."""
    now = recorded()
    reasons = []
    if row.get("method_version") != method_version:
        reasons.append(f"method {row.get('method_version') or 'unknown'} became {method_version}")
    if row.get("sources_sha256") != now["sources_sha256"]:
        was = row.get("code_version") or "unknown code"
        reasons.append(f"the planning sources changed ({was} then, {now['code_version']} now)")
    if before := str(row.get("libraries") or ""):
        texts = before, now["libraries"]
        old, new = (dict(item.rsplit(" ", 1) for item in text.split(", ") if item) for text in texts)
        for name in sorted(old.keys() | new.keys()):
            if old.get(name) != new.get(name):
                reasons.append(f"{name} {old.get(name, 'none')} became {new.get(name, 'none')}")
    else:
        reasons.append("the versions of its libraries were not recorded")
    if row.get("machine") and row["machine"] != now["machine"]:
        reasons.append(f"another machine ({row['machine']} then, {now['machine']} now)")
    return reasons


def _commit(git: Path) -> str:
    """The commit that a checkout is at (hex); empty where there is none or it cannot be told."""

    def text(path: Path) -> str:
        return path.read_text(encoding="utf-8").strip() if path.exists() else ""

    with suppress(OSError, UnicodeDecodeError):
        if git.is_file():  # a work tree beside its repository
            git = (git.parent / text(git).removeprefix("gitdir:").strip()).resolve()
        head = text(git / "HEAD")
        if not head.startswith("ref:"):
            return head
        name = head.removeprefix("ref:").strip()
        for place in (git, (git / text(git / "commondir")).resolve()):
            packed = (line.split(" ", 1) for line in text(place / "packed-refs").splitlines())
            known = [commit for commit, *names in packed if names == [name]]
            if commit := text(place / name) or "".join(known[:1]):
                return commit
    return ""
