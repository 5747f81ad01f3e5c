"""What the storage raises, as errors that people read."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from typing import TypeVar

import pyarrow as pa
from deltalake.exceptions import DeltaError, SchemaMismatchError

from upplied.errors import CatalogError

T = TypeVar("T")

_SETTINGS = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION")


def explained(what: str, act: Callable[[], T], *passed: type[Exception]) -> T:
    """Do it; what the storage raises becomes an error that people read."""
    try:
        return act()
    except passed:
        raise
    except CatalogError:
        raise
    except SchemaMismatchError as error:
        raise CatalogError(what, f"has other columns: {_brief(error)}", "", "use a newer version") from None
    except (DeltaError, OSError, pa.ArrowException) as error:
        raise CatalogError(what, _brief(error), "", remedy_of(what, str(error))) from None


def _brief(error: Exception) -> str:
    """The first line of what the storage said, at a length that fits a screen."""
    return str(error).strip().split("\n")[0][:300]


def remedy_of(what: str, said: str) -> str:
    """What a person can do about it."""
    if "://" in what:
        return _remedy_of_store(what)
    if "No space" in said or "os error 28" in said or "File too large" in said:
        return "free some space; nothing was changed"
    if "ermission" in said or "ead-only" in said:
        return "ask for the right to read and write there; nothing was changed"
    if "Parquet" in said or "Json error" in said or "parquet" in said:
        return "take that file, or the table's folder, from a backup; nothing was changed"
    return ""


def _remedy_of_store(uri: str) -> str:
    """Which bucket was asked for, where, and which settings are missing; never what is in them."""
    bucket = re.sub(r"^[a-z0-9]+://([^/]*).*$", r"\1", uri)
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL") or ""
    where = re.sub(r"//[^/@]*@", "//", endpoint) or "the store's own (AWS_ENDPOINT_URL is not set)"
    missing = [name for name in _SETTINGS if not os.environ.get(name)]
    if "AWS_REGION" in missing and os.environ.get("AWS_DEFAULT_REGION"):
        missing.remove("AWS_REGION")
    if endpoint.startswith("http://") and os.environ.get("AWS_ALLOW_HTTP", "").lower() != "true":
        missing.append("AWS_ALLOW_HTTP=true (the endpoint is http)")
    lacking = f"; not set in the environment: {', '.join(missing)}" if missing else ""
    return f"bucket {bucket} was requested at {where}{lacking}; nothing was changed"
