"""``mbstudio gui``: the window."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import inputs
from mbstudio.core.errors import MbstudioError


def gui(
    source: Annotated[
        Path | None, typer.Argument(metavar="[SCAN|PROJECT]", help="What to open; nothing by default.")
    ] = None,
    sample: Annotated[bool, typer.Option("--sample", help="Open the built-in sample scan.")] = False,
    voxel_size: inputs.VoxelSizeOption = None,
) -> None:
    """Open the window."""
    if sample and source is not None:
        raise MbstudioError(f"Give either --sample or {source}, not both.")
    if sys.platform.startswith("linux") and not any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    ):
        raise MbstudioError(
            "There is no display for a window here: use 'mbstudio tour', or start it on a desktop."
        )
    project = scan = None
    if sample:
        from mbstudio.core.scan import sample_scan

        scan = sample_scan().scan
    elif source is not None and inputs.is_project(source):
        project = source
    elif source is not None:
        scan = inputs.open_input_scan(source, voxel_size)
    from mbstudio.ui.app import run

    raise typer.Exit(run(project_path=project, scan=scan))
