"""HTML pages that need nothing from elsewhere: scripts beside them or all in one file, a strict policy.

Data enters a page only as JSON in a block that is not executed, with every ``<``, ``>`` and ``&``
escaped; the page's script writes it as text, never as markup.
"""

import base64
import hashlib
import html
import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

from upplied.extras import extra
from upplied.outputs import colours
from upplied.outputs.labels import LABELS

PLOTLY, CORE = "plotly.min.js", ("core.js", "labels.js")
#: Tables of labels that pages show.
_TABLES = ("research", "quality", "fleet", "fleet_research", "moves", "pose", "zone_limits")
#: Scripts of each kind of page between those of all and `start.js`; 3-D views load the drawing library later.
KINDS = {
    "fleet": ("fleet.js",),
    "transfer": ("scene.js", "fly.js", "transfer.js"),
    "structure": ("scene.js", "structure.js"),
    "about": ("structure.js",),
}
_LIVE: dict[str, tuple[str, ...]] = {"login": (), "studio": ("scene.js", "studio.js")}
STYLES = ("report.css",)
#: Files of the package that every report folder holds once, under ``assets/``.
SCRIPTS = (PLOTLY, *CORE, *dict.fromkeys(name for names in KINDS.values() for name in names), "start.js")

_POLICY = (
    "default-src 'none'; script-src {scripts}; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src {connect}"
)


def page(
    kind: str,
    title: str,
    data: Mapping[str, Any],
    fallback: str,
    root: str = "",
    extra: Sequence[str] = (),
    live: bool = False,
) -> str:
    """A page of a report folder, or of the application, which builds the same pages on request.

    Kinds are those of `KINDS`, and ``login`` and ``studio`` of the application alone. Title and fallback,
    which is shown where scripts are off, are plain text; NaN in the data becomes null. `root` leads from the
    page to the report folder, ``""`` or ``"../"``; `extra` are further scripts, relative to that. On a `live`
    page a person who signed in may decide, export and edit.
    """
    names = [*CORE, *(["live.js"] if live else []), *(KINDS | _LIVE)[kind]]
    scripts = [*(f"assets/{name}" for name in names), *extra, "assets/start.js"]
    return _shell(title, scripts, {**data, "root": root, "live": live}, fallback, root, live, "")


def login_page() -> str:
    """The page for signing in: only a field for the password."""
    return page("login", "Sign in", {"login": True}, "Signing in needs scripts.", "/", live=True)


def studio_page(transfer_id: str) -> str:
    """The page of the studio; its script requests the plan."""
    return page("studio", "Studio", {"studio": transfer_id}, "The studio needs scripts.", "/", live=True)


def message_page(text: str) -> str:
    """A page with the reason why the requested one is not available."""
    body = f'<h1>Not available</h1><p class="verdict failed">{html.escape(text)}</p><a href="/">All plans</a>'
    return _shell("Not available", [], {}, "", "/", True, body)


def _shell(
    title: str, scripts: Sequence[str], data: dict[str, Any], fallback: str, root: str, live: bool, body: str
) -> str:
    """A page whose scripts and styles are files beside it."""
    policy = _POLICY.format(scripts="'self'", connect="'self'" if live else "'none'")
    sheets = [f'<link rel="stylesheet" href="{root}assets/{name}">' for name in STYLES]
    sheets += ['<link rel="icon" href="data:,">'] * live  # or browsers ask for one
    tags = [f'<script src="{html.escape(root + name)}"></script>' for name in scripts]
    return _document(title, policy, sheets, _app(data, fallback, tags, body))


def single_page(title: str, data: Mapping[str, Any], fallback: str) -> str:
    """A page with all scripts inside, for mail; they run only if their hash is in the page's policy."""
    sources = [asset(name).replace("</script", "<\\/script") for name in SCRIPTS]
    digests = (base64.b64encode(hashlib.sha256(source.encode()).digest()).decode() for source in sources)
    policy = _POLICY.format(scripts=" ".join(f"'sha256-{each}'" for each in digests), connect="'none'")
    tags = [f"<script>{source}</script>" for source in sources]
    body = _app({**data, "root": "", "live": False}, fallback, tags)
    return _document(title, policy, [f"<style>{asset(name)}</style>" for name in STYLES], body)


def _app(data: Mapping[str, Any], fallback: str, tags: Sequence[str], body: str = "") -> str:
    parts = {"body": body, "fallback": html.escape(fallback), "data": inert_json(data)}
    return asset("app.html").format(**parts, scripts="\n".join(tags))


def _document(title: str, policy: str, sheets: Sequence[str], body: str) -> str:
    head = {"policy": policy, "title": html.escape(title), "styles": "\n".join(sheets)}
    return asset("page.html").format(**head, body=body)


def paper_page(title: str, style: str, body: str) -> str:
    """A page for paper: a style sheet of the package inside, no scripts, nothing from elsewhere."""
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    return _document(title, policy, [f"<style>\n{asset(style)}</style>"], f"<main>\n{body}\n</main>")


def structure_script(data: Mapping[str, Any]) -> str:
    """A script that hands one structure to the pages; browsers load scripts, but no data, from a folder."""
    return f"upplied.structures[{inert_json(data['id'])}] = {inert_json(data)};\n"


def assets() -> dict[str, str]:
    """The files under ``assets/`` of a report folder, by name."""
    return {name: asset(name) for name in (*SCRIPTS, *STYLES)}


def live_assets() -> dict[str, str]:
    """The files under ``assets/``, with those of the application."""
    return assets() | {name: asset(name) for name in ("live.js", "studio.js")}


def image_address(content: bytes, kind: str = "png") -> str:
    """A picture as an address that a page shows; `kind` is ``png`` or ``svg+xml``."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def inert_json(value: Any) -> str:
    """JSON that no HTML parser can mistake for markup and no script for code.

    >>> inert_json("</script>")
    '"\\\\u003c/script\\\\u003e"'
    """
    text = json.dumps(finite(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def finite(value: Any) -> Any:
    """The same value with None in place of NaN and infinity."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


@cache
def asset(name: str) -> str:
    """The text of a file of the package that pages need."""
    if name == PLOTLY:
        with extra("export"):
            from plotly.offline import get_plotlyjs

        return str(get_plotlyjs())
    if name == "labels.js":
        states = [("not inspected", colours.SURFACE), *list(colours.STATES.items())[1:]]
        tables = {table: LABELS[table] for table in _TABLES}
        drawn = {"labels": tables, "COLOURS": colours.PATHS, "STATES": states}
        return f"Object.assign(upplied, {inert_json(drawn)});\n"
    return resources.files("upplied.outputs").joinpath("static", name).read_text("utf-8")
