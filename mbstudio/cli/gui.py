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
    source: Annotated[
        Path | None, typer.Argument(metavar="[SCAN|PROJECT]", help="Scan or project to open.")
    ] = None,
    sample: Annotated[bool, typer.Option("--sample", help="Start with the built-in sample scan.")] = False,
) -> None:
    """Run ``mbstudio gui``; `HELP` says what it does."""
    from mbstudio.scene.pictures.offscreen import has_display

    if sample and source is not None:
        raise MbstudioError(f"Give either --sample or {source}, not both.")
    if source is not None and not source.exists():
        raise MbstudioError(f"{source} does not exist: check the name and the folder.")
    if not has_display() and not os.environ.get("QT_QPA_PLATFORM"):
        raise MbstudioError(
            "There is no display for the window: use 'mbstudio tour' instead, or run it on a desktop."
        )
    from mbstudio.ui.shell.collection import pause_collection

    pause_collection()
    from mbstudio.ui.shell.app import run

    is_project = source is not None and inputs.is_project(source)
    raise typer.Exit(
        run(
            project_path=source if is_project else None,
            scan=None if is_project else source,
            sample=sample,
        )
    )
