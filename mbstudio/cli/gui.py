"""``mbstudio gui``: the window."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import inputs
from mbstudio.core.errors import MbstudioError

HELP = "Open the window."


def gui(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[SCAN|PROJECT|MESHES...]", help="Scan, project or meshes to open."),
    ] = None,
    sample: Annotated[bool, typer.Option("--sample", help="Start with the built-in sample scan.")] = False,
) -> None:
    """Run ``mbstudio gui``; `HELP` says what it does."""
    from mbstudio.core.meshes.listing import means_meshes
    from mbstudio.scene.pictures.offscreen import has_display

    given = sources or []
    if sample and given:
        raise MbstudioError(f"Give either --sample or {given[0]}, not both.")
    for source in given:
        if not source.exists() and not means_meshes(source):
            raise MbstudioError(f"{source} does not exist: check the name and the folder.")
    if len(given) > 1 or (given and means_meshes(given[0])):
        given = inputs.meshes_among(given) or []
    if not has_display() and not os.environ.get("QT_QPA_PLATFORM"):
        raise MbstudioError(
            "There is no display for the window: use 'mbstudio tour' instead, or run it on a desktop."
        )
    from mbstudio.ui.shell.collection import pause_collection

    pause_collection()
    from mbstudio.ui.shell.app import run

    raise typer.Exit(run(files=given, sample=sample))
