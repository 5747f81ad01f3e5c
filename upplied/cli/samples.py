"""`upplied samples`: a fleet to try things on."""

from __future__ import annotations

import shlex
from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import console, next_step, progress

app = App(name="samples", help="Write a sample fleet to try.")


@app.command
def write(folder: Path = Path("samples")) -> int:
    """Write meshes, their manifest and a simulated pilot's logs.

    Parameters
    ----------
    folder : Path
        Folder to write; created when missing.
    """
    from upplied.outputs.sample_fleet import FILES, write_sample_fleet

    with progress("files", FILES) as advance:
        write_sample_fleet(folder, lambda _: advance())
    console.print(f"{folder / 'structures.toml'} and its logs", soft_wrap=True)
    next_step(f"structures add {shlex.quote(str(folder / 'structures.toml'))}", "import the meshes")
    return 0
