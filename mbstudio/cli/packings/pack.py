"""``mbstudio pack``: grains poured into a mould, settled and measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.packings.sources import avatars_of, clones_of, write_and_print
from mbstudio.core.errors import PackingError

if TYPE_CHECKING:
    from mbstudio.core.packing.comparing import PackingComparison

HELP = """Pour grains into a mould, let them settle, and measure porosity, coordination and fabric.

MuJoCo settles them as clumps of spheres with the avatars' mass and inertia. Porosity is counted on the
avatars in the inner part, away from walls, floor and surface. The output folder holds poses.csv,
contacts.csv, profile.csv (porosity by height), walls.csv (by distance from the walls), packing.vtp for
ParaView, packing.ply and summary.json. With --against two kinds of grains are packed with several seeds
and compared.
"""
InsetOption = Annotated[
    float,
    typer.Option(
        "--inset", min=0.0, help="Distance of the measures from walls, floor and surface, in mean D_n."
    ),
]


def pack(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="PROJECT",
            help="A project with avatars, or a folder of 'mbstudio generate' or 'export --to metaball'.",
        ),
    ],
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder of the packing.")
    ] = None,
    clones: Annotated[bool, typer.Option("--clones", help="Pack the project's clones.")] = False,
    select: Annotated[
        str, typer.Option("--select", metavar="all|valid|3,5,9", help="Avatars of the project to pack.")
    ] = "valid",
    count: Annotated[int, typer.Option("--count", help="Number of grains.")] = 200,
    friction: Annotated[float, typer.Option("--friction", help="Between grains.")] = 0.5,
    wall_friction: Annotated[
        float | None, typer.Option("--wall-friction", help="Between grains and mould; by default the same.")
    ] = None,
    mould: Annotated[str, typer.Option("--mould", metavar="box|cylinder", help="The mould.")] = "box",
    width: Annotated[
        float | None,
        typer.Option(
            "--width", help="Of the mould, in the avatars' unit; by default about the settled height."
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same packing.")] = 0,
    spheres: Annotated[int, typer.Option("--spheres", help="Number of spheres of each clump.")] = 20,
    inset: InsetOption = 1.0,
    against: Annotated[
        Path | None,
        typer.Option(
            "--against",
            metavar="CLONES",
            help="Compare with these: a folder of clones, or the project itself for its clones.",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=2, help="Packings of each kind in a comparison.")] = 3,
    with_spheres: Annotated[
        bool, typer.Option("--with-spheres", help="Also compare with spheres of the same volumes.")
    ] = False,
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio pack``; `HELP` says what it does."""
    from mbstudio.core.packing.packer import pack as pack_avatars

    avatars = clones_of(source) if clones else avatars_of(source, select)
    options: dict[str, Any] = {
        "friction": friction, "wall_friction": wall_friction, "mould": mould, "width": width,
        "spheres": spheres, "processes": workers,
    }  # fmt: skip
    if against is None and not with_spheres:
        with console.progress("Packing") as tell:
            packing = pack_avatars(avatars, count, seed=seed, progress=tell, **options)
        write_and_print(packing, folder, inset, f"Packing of {source.name}", as_json=as_json)
        return
    if folder is not None:
        raise PackingError("A comparison is printed and not written: leave out --output, or use --json.")
    from mbstudio.core.packing.comparing import compare_packings

    groups = {source.name: avatars}
    if against is not None:
        name = "clones" if against == source else against.name
        groups[str(against) if name in groups else name] = clones_of(against)
    with console.progress("Packing") as tell:
        found = compare_packings(
            groups, seeds=seeds, with_spheres=with_spheres, inset=inset, progress=tell, count=count, **options
        )
    if as_json:
        console.print_json(found.as_dict())
    else:
        _print(found)


def _print(found: PackingComparison) -> None:
    console.print_table(
        "Means and standard errors",
        ("", "porosity", "coordination", "anisotropy"),
        [
            (name, *(f"{mean.value:.4f} ± {mean.error:.4f}" for mean in means.values()))
            for name, means in found.means.items()
        ],
    )
    console.print_table(
        "Differences",
        ("", "of", "to", "difference", "by chance", "differs"),
        [
            (d.measure, d.second, d.first, f"{d.value:+.4f} ± {d.error:.4f}", f"{d.chance:.2g}",
             "yes" if d.differs else "no")
            for d in found.differences
        ],
    )  # fmt: skip
