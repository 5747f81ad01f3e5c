"""HTML pages that need nothing from elsewhere: scripts beside them or all in one file, a strict policy.

Data enters a page only as JSON in a block that is not executed, with every ``<``, ``>`` and ``&``
escaped; the page's script writes it as text, never as markup.
"""

from __future__ import annotations

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

#: Files of the package's own that every report folder holds once, under ``assets/``.
SCRIPTS = ("plotly.min.js", "core.js", "fleet.js", "scene.js", "verdict.js", "transfer.js", "start.js")
#: Those that the fleet's own page needs: it draws nothing, and opens without the drawing library.
FLEET_SCRIPTS = ("core.js", "fleet.js", "start.js")
STUDIO_SCRIPTS = ("plotly.min.js", "core.js", "scene.js", "studio.js")
STYLES = ("report.css",)

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
{styles}
</head>
<body>
<main id="app"></main>
<noscript>{fallback}</noscript>
<script type="application/json" id="data">{data}</script>
{scripts}
</body>
</html>
"""
_STUDIO = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>Studio</title>
{styles}
</head>
<body>
<main id="app"><p role="status">Opening the plan …</p></main>
<noscript>The studio needs scripts; they come from this machine alone.</noscript>
{scripts}
</body>
</html>
"""
_POLICY = (
    "default-src 'none'; script-src {scripts}; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:"
)


def fleet_page(title: str, data: Mapping[str, Any], fallback: str) -> str:
    """The page of the fleet, at the root of a report folder; parameters as of `page`."""
    return _folder_page(title, data, fallback, "", [f"assets/{name}" for name in FLEET_SCRIPTS])


def page(title: str, data: Mapping[str, Any], fallback: str, root: str, extra: Sequence[str] = ()) -> str:
    """A page of a report folder.

    Parameters
    ----------
    title, fallback : str
        Plain text; the fallback is shown where scripts are off.
    data : mapping
        What the page shows; NaN becomes null.
    root : str
        From the page to the report folder, ``""`` or ``"../"``.
    extra : sequence of str
        Further scripts, relative to the report folder.
    """
    scripts = [f"assets/{name}" for name in SCRIPTS[:-1]] + list(extra) + [f"assets/{SCRIPTS[-1]}"]
    return _folder_page(title, data, fallback, root, scripts)


def _folder_page(
    title: str, data: Mapping[str, Any], fallback: str, root: str, scripts: Sequence[str]
) -> str:
    return _PAGE.format(
        policy=_POLICY.format(scripts="'self'"),
        title=html.escape(title),
        styles="\n".join(f'<link rel="stylesheet" href="{root}assets/{name}">' for name in STYLES),
        fallback=html.escape(fallback),
        data=inert_json(data),
        scripts="\n".join(f'<script src="{root}{html.escape(name)}"></script>' for name in scripts),
    )


def single_page(title: str, data: Mapping[str, Any], fallback: str) -> str:
    """The same with everything inside, for mail: scripts run only if their hash is in the page's policy."""
    sources = [_asset(name).replace("</script", "<\\/script") for name in SCRIPTS]
    hashes = " ".join(f"'sha256-{_sha256(source)}'" for source in sources)
    return _PAGE.format(
        policy=_POLICY.format(scripts=hashes),
        title=html.escape(title),
        styles="\n".join(f"<style>{_asset(name)}</style>" for name in STYLES),
        fallback=html.escape(fallback),
        data=inert_json(data),
        scripts="\n".join(f"<script>{source}</script>" for source in sources),
    )


def structure_script(data: Mapping[str, Any]) -> str:
    """A script that hands one structure to the pages; browsers load scripts, but no data, from a folder."""
    return f"upplied.structures[{inert_json(data['id'])}] = {inert_json(data)};\n"


def assets() -> dict[str, str]:
    """The files under ``assets/`` by name."""
    return {name: _asset(name) for name in (*SCRIPTS, *STYLES)}


def studio_files() -> dict[str, tuple[str, str]]:
    """The page of the studio and what it loads: type and text by name."""
    scripts = {name: ("text/javascript", _asset(name)) for name in STUDIO_SCRIPTS}
    styles = {name: ("text/css", _asset(name)) for name in (*STYLES, "studio.css")}
    head = "\n".join(f'<link rel="stylesheet" href="{name}">' for name in styles)
    body = "\n".join(f'<script src="{name}"></script>' for name in scripts)
    return {**scripts, **styles, "index.html": ("text/html", _STUDIO.format(styles=head, scripts=body))}


def inert_json(value: Any) -> str:
    """JSON that no HTML parser can mistake for markup and no script for code.

    Examples
    --------
    >>> inert_json("</script>")
    '"\\\\u003c/script\\\\u003e"'
    """
    text = json.dumps(finite(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def finite(value: Any) -> Any:
    """The same with null for what is no finite number."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


@cache
def _asset(name: str) -> str:
    if name == "plotly.min.js":
        with extra("export"):
            from plotly.offline import get_plotlyjs

        return str(get_plotlyjs())
    return resources.files("upplied.outputs").joinpath("static", name).read_text("utf-8")


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
