"""The mesh half of `upplied structures check`: one file in words and as a picture."""

from __future__ import annotations

from pathlib import Path

from upplied.cli.terminal import console


def check_mesh(file: Path, png: Path | None) -> int:
    """Say how a mesh or cloud file is, and draw it; 1 when it would be refused."""
    from upplied.inputs.health import health_report
    from upplied.outputs.figures import save, structure_png

    report = health_report(file)
    console.print(report.text, markup=False, soft_wrap=True)
    goal = png or Path(f"{file.stem}-check.png")
    save(goal, structure_png(report.structure, title=file.name))
    console.print(f"  picture     {goal}", markup=False, soft_wrap=True)
    return int(bool(report.problems))
