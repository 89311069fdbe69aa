"""``mbstudio figures``: the explaining figures of the paper, drawn anew from grains made here."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import MbstudioError

HELP = "Draw the paper's figures 2, 3, 5 and 6 from synthetic grains."


def figures(
    folder: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Output folder.")] = Path(
        "figures"
    ),
    grains: Annotated[
        int, typer.Option("--grains", min=1, help="Number of grains of each of the four kinds.")
    ] = 2,
    diameter: Annotated[
        float, typer.Option("--diameter", min=16, max=400, metavar="VOXELS", help="Diameter of the grains.")
    ] = 80.0,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio figures``; `HELP` says what it does."""
    from mbstudio.scene.pictures.offscreen import prepare_offscreen_rendering

    prepare_offscreen_rendering()
    if folder.exists() and not folder.is_dir():
        raise MbstudioError(f"{folder} is a file: give the name of a folder with --out.")
    folder.mkdir(parents=True, exist_ok=True)
    from mbstudio.scene.figures.paper_figures import FigurePlan, render_paper_figures

    begun = time.monotonic()
    with console.progress("Drawing figures") as report:
        written = render_paper_figures(folder, FigurePlan(grains=grains, diameter=diameter), progress=report)
    summary = {"folder": folder, "files": [path.name for path in written],
               "seconds": round(time.monotonic() - begun, 1)}  # fmt: skip
    if as_json:
        console.print_json(summary)
        return
    for path in written:
        print(path)
