"""Whole files or none, in a folder or an object store; where a catalog and its cache lie; and locks."""

import contextlib
import os
import re
import threading
import uuid
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote, urlsplit

import pyarrow as pa
import pyarrow.fs as pafs
from deltalake import DeltaTable
from deltalake.exceptions import CommitFailedError, DeltaError, SchemaMismatchError

from upplied.errors import CatalogError
from upplied.files import replace_file, sync_path

_FIRST = ".first"  # ends the name of the table by which the first writer of a file is known
_CONTENT = "upplied.content"  # property of a table that stands for a file


class FileStore:
    """Files under one root, a folder or an object store's URI, that are written once and then only read."""

    def __init__(self, root: str) -> None:
        self.root = root.rstrip("/")
        self.local = "://" not in root
        self._filesystem: pafs.FileSystem | None = None

    def path(self, name: str) -> str:
        """Where a file lies."""
        return f"{self.root}/{name}"

    def has(self, name: str) -> bool:
        """Whether the file is there, or on a disk anything else in its place."""
        kind = self.filesystem().get_file_info(name).type
        return bool(kind != pafs.FileType.NotFound if self.local else kind == pafs.FileType.File)

    def touched(self, name: str) -> bool:
        """Whether the file is there; on a disk it counts as used now, so that no cleaning takes it."""
        if self.local:
            with contextlib.suppress(FileNotFoundError, PermissionError):  # of somebody else's
                os.utime(self.path(name))
        return self.has(name)

    def has_folder(self, name: str) -> bool:
        """Whether there is a folder of that name with anything in it."""
        return bool(self._entries(name))

    def names(self) -> list[str]:
        """The names of the files at the root, sorted; none where there is no such folder."""
        return sorted(item.base_name for item in self._entries())

    def older(self, moment: datetime) -> list[str]:
        """The names of the files at the root that nobody wrote or used since a moment, by their stamps."""
        return sorted(item.base_name for item in self._entries() if item.mtime and item.mtime < moment)

    def _entries(self, folder: str = "") -> list[pafs.FileInfo]:
        try:
            entries = self.filesystem().get_file_info(pafs.FileSelector(folder, allow_not_found=True))
        except NotADirectoryError:
            return []
        return [item for item in entries if not item.base_name.endswith(_FIRST)]

    def write(self, name: str, content: bytes, lasting: bool = True) -> None:
        """Write a file that appears whole; on a disk it is there to stay when this returns, if `lasting`."""
        if self.local:
            replace_file(Path(self.path(name)), content, lasting)
            return
        with self.filesystem().open_output_stream(name) as stream:
            stream.write(content)

    def read(self, name: str) -> bytes:
        """The bytes of a file."""
        with self.filesystem().open_input_file(name) as stream:
            return bytes(stream.read())

    def create(self, name: str, content: bytes) -> None:
        """Write a file unless it is there; of several who do so at once one alone succeeds."""
        if not self.local:
            if not self.has(name):
                self.write(name, self._first(name, content))
            return
        path = Path(self.path(name))
        draft = path.with_name(f".{name}.{uuid.uuid4().hex[:8]}.draft")
        replace_file(draft, content)
        try:
            os.link(draft, path)
        except OSError:  # it is there, or the disk has no links
            if not path.exists():
                os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
        sync_path(path.parent)

    def _first(self, name: str, content: bytes) -> bytes:
        # Pyarrow always replaces what is there; delta-rs puts the first entry of a log where there is none.
        uri = self.path(name + _FIRST)
        try:
            schema, setting = pa.schema([("content", pa.string())]), {_CONTENT: content.decode()}
            with contextlib.suppress(CommitFailedError):
                DeltaTable.create(uri, schema, "ignore", configuration=setting, raise_if_key_not_exists=False)
            return str(DeltaTable(uri).metadata().configuration[_CONTENT]).encode()
        except DeltaError as error:
            raise OSError(str(error)) from None

    def remove(self, name: str) -> None:
        """Remove a file; nothing where it is not there."""
        with contextlib.suppress(FileNotFoundError):
            self.filesystem().delete_file(name)

    def remove_folder(self, name: str) -> None:
        """Remove a folder with what is in it; what hinders that leaves it there."""
        with contextlib.suppress(OSError):
            self.filesystem().delete_dir(name)

    def filesystem(self) -> pafs.FileSystem:
        """The root as pyarrow's own file system, in which names are paths."""
        if self._filesystem is None:
            local = pafs.LocalFileSystem(), self.root
            store, root = local if self.local else pafs.FileSystem.from_uri(self.root)
            self._filesystem = pafs.SubTreeFileSystem(root, store)
        return self._filesystem


def checked(location: str) -> str:
    """An absolute folder, or a URI that carries no credential."""
    if location.startswith("file://"):
        parts = urlsplit(location)
        if parts.netloc not in ("", "localhost") or not parts.path:
            raise CatalogError(location, "is no file of this machine", "file:///folder")
        return str(Path(unquote(parts.path)))
    if "://" not in location:
        return str(Path(location).expanduser().absolute())
    scheme, _, rest = location.partition("://")
    if "@" in rest or "?" in rest:
        fault = "has a user, a password or options in it"
        remedy = "put credentials into the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, ...)"
        raise CatalogError(f"location {scheme}://...", fault, f"{scheme}://bucket/prefix", remedy)
    if not rest.strip("/"):
        raise CatalogError(f"location {location}", "names no bucket", f"{scheme}://bucket/prefix")
    return location.rstrip("/")


def cache_folder(location: str) -> Path:
    """Beside the tables of a folder; for an object store in the user's cache directory."""
    if "://" not in location:
        return Path(location) / "cache"
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return home / "upplied" / "".join(c if c.isalnum() else "-" for c in location)


T = TypeVar("T")


def explained(what: str, act: Callable[[], T], *passed: type[Exception], doing: str = "") -> T:
    """Do it; what the storage raises becomes an error that people read, of what it was `doing`."""
    try:
        return act()
    except passed:
        raise
    except CatalogError:
        raise
    except SchemaMismatchError as error:
        raise CatalogError(what, f"has other columns: {_brief(error)}", "", "use a newer version") from None
    except (DeltaError, OSError, pa.ArrowException) as error:
        fault = f"cannot be {doing}: {_brief(error)}" if doing else _brief(error)
        raise CatalogError(what, fault, "", remedy_of(what, str(error))) from None


def _brief(error: Exception) -> str:
    return str(error).strip().split("\n")[0][:300]


def remedy_of(what: str, message: str) -> str:
    """What a person can do about it; of a store which bucket was requested where, and what is not set."""
    if "://" not in what:
        if "No space" in message or "os error 28" in message or "File too large" in message:
            return "free some space; nothing was changed"
        if "ermission" in message or "ead-only" in message:
            return "ask for the right to read and write there; nothing was changed"
        if "arquet" in message or "Json error" in message:
            return "take that file, or the table's folder, from a backup; nothing was changed"
        return ""
    bucket = re.sub(r"^[a-z0-9]+://([^/]*).*$", r"\1", what)
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL") or ""
    where = re.sub(r"//[^/@]*@", "//", endpoint) or "the store's own (AWS_ENDPOINT_URL is not set)"
    needed = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION")
    missing = [name for name in needed if not os.environ.get(name)]  # never what is in them
    if "AWS_REGION" in missing and os.environ.get("AWS_DEFAULT_REGION"):
        missing.remove("AWS_REGION")
    if endpoint.startswith("http://") and os.environ.get("AWS_ALLOW_HTTP", "").lower() != "true":
        missing.append("AWS_ALLOW_HTTP=true (the endpoint is http)")
    lacking = f"; not set in the environment: {', '.join(missing)}" if missing else ""
    return f"bucket {bucket} was requested at {where}{lacking}; nothing was changed"


PATIENCE_S = 1800.0  # a publication of a large fleet takes minutes
_TURN_S = 5.0  # of a writer that holds its turn for longer nobody waits: it was stopped, or is far away


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock until the process ends or leaves; where there are no locks it counts as held."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ".lock").touch()
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(folder), f"cannot be written: {error}", "", remedy) from None
    with _waited(PATIENCE_S, folder / ".lock") as lock:
        if not lock:
            raise CatalogError(str(folder), "somebody else has been publishing there for long")
        yield


@contextlib.contextmanager
def turn(path: Path) -> Iterator[None]:
    """Wait for the others who do the same, for some seconds at most; a courtesy, which nothing depends on."""
    # Nobody overtakes: the first who waits holds a second lock, which whoever comes back for another turn
    # needs too. The kernel wakes them: looks now and then would mostly find the turn taken.
    with _waited(_TURN_S, path.with_suffix(".next"), path):
        yield


@contextlib.contextmanager
def _waited(patience_s: float, *paths: Path) -> Iterator[bool]:
    """Wait for the last of some locks, each held until the next one is; whether it is held."""
    # A thread waits in the kernel, which knows no patience; who gives up leaves it to pass the lock on.
    handles, closing = list[int](), threading.Lock()
    ended, left = threading.Event(), threading.Event()

    def wait() -> None:
        with contextlib.suppress(OSError, ImportError):
            import fcntl

            for path in paths:
                path.parent.mkdir(parents=True, exist_ok=True)
                handles.append(handle := os.open(path, os.O_RDWR | os.O_CREAT, 0o644))
                fcntl.flock(handle, fcntl.LOCK_EX)
                if len(handles) > 1:
                    os.close(handles.pop(0))
        ended.set()
        close()

    def close() -> None:
        with closing:
            while handles and ended.is_set() and left.is_set():
                os.close(handles.pop())

    threading.Thread(target=wait, name=f"lock of {paths[-1].name}", daemon=True).start()
    try:
        yield ended.wait(patience_s)
    finally:
        left.set()
        close()
