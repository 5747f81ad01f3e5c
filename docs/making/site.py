"""What the site says from the code itself: reference pages, data dictionary, settings, commands, examples.

A hook of MkDocs: nothing here is written to `docs/`, so nothing can grow stale.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

sys.path.insert(0, str(Path(__file__).parent))
from comments import comments
from constants import constants_page
from house import house_page, public_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
#: What a program may build on, by room.
MODULES = {
    "Records": ["upplied.records", "upplied.errors", "upplied.geometry.poses", "upplied.geometry.scene"],
    "Inputs": ["upplied.inputs.manifests", "upplied.inputs.meshes", "upplied.inputs.logs"],
    "Planning": [
        "upplied.planning.plan",
        "upplied.planning.correspondence.pair",
        "upplied.planning.correspondence.siblings",
        "upplied.planning.correspondence.registration",
        "upplied.planning.correspondence.correspondences",
        "upplied.planning.visibility.line_of_sight",
        "upplied.planning.demonstration.stations",
        "upplied.planning.carry.affine",
        "upplied.planning.airspace.detours",
        "upplied.planning.trajectory.retime",
        "upplied.planning.measures.evaluate",
        "upplied.planning.measures.attainable",
        "upplied.planning.geometry.frechet",
        "upplied.planning.correspondence.misfit",
    ],
    "Catalog": ["upplied.catalog", "upplied.catalog.database"],
    "Fleet": ["upplied.fleet.decide", "upplied.fleet.ingest", "upplied.fleet.run"],
    "Outputs": [
        "upplied.outputs.missions",
        "upplied.outputs.mission_options",
        "upplied.outputs.render",
        "upplied.outputs.figures",
        "upplied.outputs.publish",
        "upplied.outputs.logs",
        "upplied.outputs.learning",
    ],
    "Simulation and samples": ["upplied.simulate", "upplied.samples.fleet", "upplied.samples.pilot"],
}
#: Documents that lie elsewhere in the repository, and where the site has them.
BORROWED = {
    "CONVENTIONS.md": "reference/conventions.md",
    "CHANGELOG.md": "reference/changelog.md",
    "catalog/README.md": "reference/dictionary.md",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from the code."""
    for address, text in generated_pages().items():
        files.append(File.generated(config, address, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Put the measured table in its place, and lead links to borrowed documents to their pages."""
    markdown = markdown.replace(
        "<!-- measured -->", (ROOT / "docs/pictures/measured.md").read_text(encoding="utf-8")
    )
    markdown = re.sub(r"\]\((\.\./)+examples/[^)]*\)", "](../examples.md)", markdown)
    up = "../" * page.file.src_uri.count("/")
    for document, address in BORROWED.items():
        markdown = re.sub(rf"\]\((\.\./)+{re.escape(document)}", f"]({up}{address}", markdown)
    return markdown


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """The theme would fetch from the web what lets search work in a folder: ours lies beside the pages."""
    up = "../" * page.file.src_uri.count("/")
    return output.replace("https://unpkg.com/iframe-worker/shim", f"{up}assets/local-worker.js")


def on_post_template(output_content: str, **_: Any) -> str:
    """The same on the page for addresses that do not exist."""
    return output_content.replace("https://unpkg.com/iframe-worker/shim", "assets/local-worker.js")


def generated_pages() -> dict[str, str]:
    """Address to text of every page that is made from the code."""
    pages = {address: (ROOT / document).read_text(encoding="utf-8") for document, address in BORROWED.items()}
    for room, modules in MODULES.items():
        text = "\n".join(f"::: {module}\n" for module in modules)
        pages[f"reference/{room.lower().replace(' ', '-')}.md"] = f"# {room}\n\n{text}"
    pages["reference/settings.md"] = "\n".join(_settings())
    pages["reference/manifest.md"] = "\n".join(_keys())
    pages["reference/command.md"] = "\n".join(_commands())
    pages["reference/house.md"] = house_page()
    pages["reference/public.md"] = public_page()
    pages["reference/constants.md"] = constants_page()
    pages["examples.md"] = "\n".join(_examples())
    return pages


def _settings() -> Iterator[str]:
    from upplied.config import PRESETS, settings_for

    presets = [settings_for(name) for name in PRESETS]
    yield "# Settings\n\nEvery setting of a plan with its meaning and its value in each preset."
    yield "`--set STAGE.NAME=VALUE` and the flow's parameter `changes` replace single settings.\n"
    for stage in fields(presets[0]):
        if stage.name == "preset":
            continue
        kind = type(getattr(presets[0], stage.name))
        meanings = comments(kind)
        yield f"## {stage.name}\n\n{(kind.__doc__ or '').strip()}\n"
        yield "| setting | value | meaning and allowed values |\n|---|---|---|"
        for name, hint in get_type_hints(kind).items():
            values = [getattr(getattr(preset, stage.name), name) for preset in presets]
            meaning = f"{meanings.get(name, '')} *{_may_be(kind, name, hint)}*"
            yield f"| `{stage.name}.{name}` | {_by_preset(values)} | {meaning} |"
        yield ""


def _by_preset(values: list[Any]) -> str:
    """The value of all presets, or that of each."""
    from upplied.config import PRESETS

    shown = [f"`{value}`" if value not in (None, "", ()) else "none" for value in values]
    if len(set(shown)) == 1:
        return shown[0]
    return "<br>".join(f"{preset}&nbsp;{text}" for preset, text in zip(PRESETS, shown, strict=True))


def _may_be(stage: type, name: str, hint: Any) -> str:
    """The values that a setting takes, in words."""
    from upplied.config import range_of

    choices = get_args(hint)
    if get_origin(hint) is Literal:
        return ", ".join(f"`{choice}`" if choice else "none" for choice in choices)
    if hint is bool:
        return "`true`, `false`"
    low, high = range_of(stage, name)
    if low == -math.inf:
        return "pairs of names" if get_origin(hint) is tuple else "a whole number"
    words = f"from {low:,.9g}" if high == math.inf else f"{low:,.9g} to {high:,.9g}"
    return f"{words}, or none" if type(None) in choices else words


def _keys() -> Iterator[str]:
    from upplied.inputs.manifest_keys import KEYS
    from upplied.inputs.sidecar import LogOptions

    yield "# Manifest and side-car\n\n## Keys of a structure\n"
    yield "`[[structure]]` of a TOML file, or the columns of a CSV.\n"
    yield "| key | required | meaning |\n|---|---|---|"
    for name, key in KEYS.items():
        yield f"| `{name}` | {'yes' if key.required else ''} | {key.meaning} |"
    yield "\n## Facts of a flight\n"
    yield "`[inspection]` of `flight.toml` beside `flight.mcap`, or a metadata record `inspection`"
    yield "in the log, in metres and degrees. The last six are options of the reader only.\n"
    yield "| key | type | default |\n|---|---|---|"
    kinds = get_type_hints(LogOptions)
    for item in fields(LogOptions):
        kind = kinds[item.name]
        words = str(kind) if get_origin(kind) else kind.__name__
        yield f"| `{item.name}` | {words.replace(' | None', '')} | {_default(item)} |"


def _default(item: Field[Any]) -> str:
    return "" if item.default is MISSING or not item.default else str(item.default)


def _commands() -> Iterator[str]:
    from cyclopts import App

    from upplied.cli import app

    def pages(inner: App, words: tuple[str, ...]) -> Iterator[str]:
        yield f"## {' '.join(('upplied', *words))}\n\n```text\n{help_of(app, words)}\n```\n"
        for name in inner:
            if not name.startswith("-"):
                yield from pages(inner[name], (*words, name))

    yield "# The command\n\nExit codes: 0 success, 1 some files or targets were refused or failed,"
    yield "2 the command was wrong, 3 the program has a fault.\n"
    yield from pages(app, ())


def help_of(app: Any, words: tuple[str, ...]) -> str:
    """What `--help` prints, without boxes, seventy-eight letters wide."""
    from rich.console import Console

    page = io.StringIO()
    with contextlib.redirect_stdout(page):
        app.help_print(list(words), console=Console(file=page, width=78, color_system=None))
    lines = (re.sub(r"[╭╮╰╯─│]+", " ", line).rstrip() for line in page.getvalue().splitlines())
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip()


def _examples() -> Iterator[str]:
    yield "# Examples\n\nSmall scripts of the folder `examples/`."
    yield "Each is complete, writes into the current folder, and is run by the tests.\n"
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        code = path.read_text(encoding="utf-8")
        title = code.split('"""')[1].splitlines()[0].rstrip(".")
        yield f"## {title}\n\n`examples/{path.name}`\n\n```python\n{code.strip()}\n```\n"
