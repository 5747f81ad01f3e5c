"""What Prefect is told, in one place: settings, password, and where runs may read and write."""

from __future__ import annotations

import json
import os
import secrets
import tomllib
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

from upplied.errors import InputError, SettingsError
from upplied.files import replace_file

HERE = Path(__file__).parent
PROFILE = "upplied"
PASSWORD = "password.txt"  # beside the profile, for people
ADDRESS = "UPPLIED_REPORTS_URL"  # of the pages, where a server shows them
ROOTS = "UPPLIED_ROOTS"  # folders and object-store URIs that runs may read and write, separated by commas

#: Setting to value, with the reasons beside them.
SETTINGS: dict[str, str] = tomllib.loads((HERE / "settings.toml").read_text(encoding="utf-8"))


def home() -> Path:
    """The folder that the fleet is run from: its catalog, reports and `.cache` lie there."""
    return Path(os.environ.get("UPPLIED_HOME") or Path.cwd()).absolute()


def prefect_home() -> Path:
    """The folder of Prefect's own database, settings and password."""
    return Path(os.environ.get("PREFECT_HOME") or home() / ".cache" / "prefect").absolute()


def carried(name: str) -> Path:
    """A file of the project's root: one of the fleet's own folder, else as it came, in a clone or a wheel."""
    return next(path for path in (home() / name, HERE / name, HERE.parent / name) if path.is_file())


def environment(folder: Path, api_url: str) -> dict[str, str]:
    """This process's environment for Prefect processes of ours; `folder` is Prefect's own (`sign_in`)."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    ours = {"PREFECT_HOME": str(folder), "PREFECT_API_URL": api_url, "UPPLIED_HOME": str(home())}
    return variables | SETTINGS | ours


def sign_in(folder: Path, api_url: str) -> str:
    """``name:password`` of this folder's server, made once, in a profile that only its owner can read."""
    path = folder / "profiles.toml"
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    for database in folder.glob("prefect.db*"):  # as earlier versions left it
        database.chmod(0o600)
    profiles = _profiles(path)
    ours = profiles.setdefault(PROFILE, {})
    password = os.environ.get("PREFECT_SERVER_API_AUTH_STRING") or ours.get("PREFECT_SERVER_API_AUTH_STRING")
    word = password or f"upplied:{secrets.token_urlsafe(32)}"
    ours |= {
        "PREFECT_API_URL": api_url,
        "PREFECT_API_AUTH_STRING": word,
        "PREFECT_SERVER_API_AUTH_STRING": word,
    }
    lines = [f'active = "{PROFILE}"']
    for name, values in profiles.items():
        lines += ["", f"[profiles.{json.dumps(name)}]"]
        lines += [f"{setting} = {json.dumps(value)}" for setting, value in values.items()]
    replace_file(path, "\n".join(lines) + "\n", private=True)
    replace_file(folder / PASSWORD, word.partition(":")[2] + "\n", private=True)
    return str(word)


def client(port: int) -> dict[str, str]:
    """What a command needs that asks the server of this folder, or the one that the environment names."""
    folder = prefect_home()  # where the profile says the password
    address = profile(folder).get("PREFECT_API_URL") or f"http://127.0.0.1:{port}/api"
    ours = {"PREFECT_HOME": str(folder), "UPPLIED_HOME": str(home()), "PREFECT_API_URL": address}
    return SETTINGS | ours | dict(os.environ)


def profile(folder: Path) -> dict[str, str]:
    """What the profile in a folder of Prefect's says."""
    return dict(_profiles(folder / "profiles.toml").get(PROFILE, {}))


def _profiles(path: Path) -> dict[str, dict[str, str]]:
    """Prefect's profiles in a file; none where it is not there."""
    if not path.is_file():
        return {}
    try:
        return dict(tomllib.loads(path.read_text(encoding="utf-8")).get("profiles", {}))
    except ValueError as error:
        remedy = "delete the file; `upplied serve` then generates a new password"
        raise InputError(str(path), f"cannot be read: {error}", "TOML", remedy) from None


def check_roots(**locations: str | Sequence[str]) -> None:
    """Refuse locations, by parameter, outside the roots; where none is declared all may be used."""
    from prefect import runtime  # which reads its settings when it is loaded: they are made here

    roots = named_roots() or ([str(home())] if runtime.deployment.id else [])  # a deployment has its folder
    for name, value in locations.items():
        for location in filter(None, [value] if isinstance(value, str) else value):
            if roots and not any(_within(location, root) for root in roots):
                fault = "lies outside the roots that runs may use"
                rule = f"one of {', '.join(roots)}, or under it"
                remedy = f"declare it where the fleet is served: upplied serve --root, or {ROOTS}"
                raise SettingsError(f"{name} {location!r}", fault, rule, remedy)


def named_roots() -> list[str]:
    """The roots that the environment declares."""
    return [root.strip() for root in os.environ.get(ROOTS, "").split(",") if root.strip()]


def _within(location: str, root: str) -> bool:
    """Whether a location is a root or under it: links followed, and read as whoever opens it reads it."""
    place, base = _plain(location), _plain(root)
    if ("://" in place) != ("://" in base):
        return False
    if "://" in place:
        parts = unquote(place).split("/")
        return not {"..", "."} & {*parts} and "%" not in place and f"{place}/".startswith(f"{base}/")
    try:
        return Path(place).resolve().is_relative_to(Path(base).resolve())
    except (OSError, ValueError):  # no path at all
        return False


def _plain(location: str) -> str:
    """An address of a store, or a path of this machine."""
    if location.startswith("file://"):
        parts = urlsplit(location)
        return unquote(parts.path) if parts.netloc in ("", "localhost") else location
    return location.rstrip("/") if "://" in location else os.path.expanduser(location)
