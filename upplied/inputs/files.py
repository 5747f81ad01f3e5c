"""Files from outside, opened as what they are: a pipe, a device or a folder is refused, not waited for."""

import errno
import os
import stat
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib import resources
from io import BufferedReader
from pathlib import Path
from typing import Any

from defusedxml import ElementTree

from upplied.errors import InputError


def open_regular(path: Path | str) -> BufferedReader:
    """A regular file, opened to be read; OSError where it is a pipe, a device or a folder, which may hang."""
    _check_regular(os.stat(path).st_mode, path)  # before it is opened: opening a device may do something
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        _check_regular(os.fstat(handle).st_mode, path)  # and after: it may have been exchanged
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def _check_regular(mode: int, path: Path | str) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is no regular file but a pipe, a device or a socket", str(path))


def read_regular(path: Path | str, most: int, what: str = "", remedy: str = "check the path") -> bytes:
    """The bytes of a regular file, at most so many; InputError otherwise, naming it by `what` or its path."""
    what = what or str(path)
    try:
        with open_regular(path) as stream:
            if (size := os.fstat(stream.fileno()).st_size) > most:
                bound = f"{most >> 30} GB" if most >> 30 else f"{most >> 20} MB"
                raise InputError(what, f"is larger than {bound}", "", remedy)
            return stream.read(size)
    except OSError as error:
        raise InputError(what, f"cannot be read: {error.strerror or error}", "", "check the path") from None
    except ValueError as error:
        raise InputError(what, f"is no path: {error}") from None


def plain_xml(data: bytes) -> Any:
    """The root of XML without DTD and entities, the namespaces of its tags left aside."""
    root = ElementTree.fromstring(data, forbid_dtd=True)
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root


@contextmanager
def file_of(data: bytes, suffix: str) -> Iterator[str]:
    """The path of a file of these bytes alone in a folder, for libraries that read paths only."""
    with tempfile.TemporaryDirectory(prefix="upplied-") as folder:
        path = Path(folder) / f"file.{suffix}"
        path.write_bytes(data)
        yield str(path)


@contextmanager
def silent() -> Iterator[None]:
    """What libraries write of damaged files, also those in C, stays off the terminal."""
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        terminal = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)


def table(name: str) -> dict[str, Any]:
    """A TOML file of this package: what is data and no code."""
    return tomllib.loads(resources.files("upplied.inputs").joinpath(name).read_text("utf-8"))
