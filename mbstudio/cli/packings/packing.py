"""``mbstudio packing``: what engines have made of grains comes back and is measured."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.packings.pack import InsetOption
from mbstudio.cli.packings.sources import avatars_of, clones_of, write_and_print


class Action(StrEnum):
    """What is done with a packing."""

    READ = "read"


HELP = """Read a packing that an engine has made, and measure it as 'mbstudio pack' does.

'packing read FILE' takes a dump of LAMMPS (id x y z of every sphere) of a specimen that 'mbstudio export
--specimen' wrote, with --specimen its specimen.csv; or a CSV table of poses: avatar,x,y,z,qw,qx,qy,qz and
maybe scale. The avatars are those that were exported, in the same order.
"""


def packing(
    _action: Annotated[Action, typer.Argument(metavar="read", help="What to do: read.")],
    path: Annotated[Path, typer.Argument(metavar="FILE", help="A dump, or a table of poses.")],
    avatars: Annotated[
        Path,
        typer.Option(
            "--avatars", metavar="PROJECT", help="The project, or folder of control points, exported."
        ),
    ],
    specimen: Annotated[
        Path | None,
        typer.Option("--specimen", metavar="FILE", help="specimen.csv of the export; needed for a dump."),
    ] = None,
    clones: Annotated[bool, typer.Option("--clones", help="The project's clones were exported.")] = False,
    select: Annotated[
        str, typer.Option("--select", metavar="all|valid|3,5,9", help="Avatars that were exported.")
    ] = "valid",
    mould: Annotated[
        str, typer.Option("--mould", metavar="box|cylinder", help="Of a table without a specimen.")
    ] = "box",
    width: Annotated[
        float | None,
        typer.Option("--width", help="Of that mould, in the avatars' unit; by default as the grains reach."),
    ] = None,
    inset: InsetOption = 1.0,
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder of the packing.")
    ] = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio packing``; `HELP` says what it does."""
    from mbstudio.core.packing.reading import read_packing

    bodies = clones_of(avatars) if clones else avatars_of(avatars, select)
    with console.progress("Reading") as tell:
        found = read_packing(path, bodies, specimen=specimen, mould=mould, width=width, progress=tell)
    write_and_print(found, folder, inset, f"Packing of {path.name}", as_json=as_json)
