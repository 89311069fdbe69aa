"""``mbstudio learn --preset surfaces``, and ``generate`` with what it wrote."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console
from mbstudio.cli.going_on import keeping_results

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.cloning.surface_generation import SurfaceGeneration

FACTORS_TABLE = "factors.csv"


def learn_surface_style(
    read: Callable[[], tuple[list[Any], list[str]]], title: str, folder: Path, n: int | None, seed: int,
    unit: str | None, processes: int, *, takes_all: bool, as_json: bool,
) -> None:  # fmt: skip
    """Learn a style of surfaces, save it into a folder and say what it is.

    Parameters
    ----------
    read : callable
        Returns bodies (grains, avatars or meshes) and their names.
    title : str
        What the parents are called.
    folder : Path
    n : int or None
        Control points of each avatar; None: by the residual of few.
    seed : int
    unit : str or None
        Of meshes that carry none.
    processes : int
    takes_all : bool
        Whether as many bodies as there are become parents; otherwise as many as a style needs.
    as_json : bool
    """
    from mbstudio.core.cloning import parent_choice
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.parents_gap import find_gap
    from mbstudio.core.cloning.surface_style import learn_surfaces
    from mbstudio.core.cloning.surface_style_file import save_surface_style
    from mbstudio.core.metaball.avatar import Avatar

    begun = time.monotonic()
    bodies, names = read()
    solid = [_mesh_of(body) if isinstance(body, Avatar) else body for body in bodies]
    found = len(solid)
    if not takes_all:
        volumes = [float(body.volume) for body in solid]
        rows = parent_choice.spread_over_sizes(volumes, parent_choice.ENOUGH_PARENTS)
        solid, names = [solid[row] for row in rows], [names[row] for row in rows]
    if len(solid) < found:
        console.tell(
            f"mbstudio: {len(solid)} of {found:,} grains become parents, spread evenly over their sizes; "
            f"--limit {found} takes all, which needs time and memory."
        )
    with console.progress("Registering") as report:
        style = learn_surfaces(solid, names, unit=unit, seed=seed, progress=report)
    with console.progress("Fitting avatars") as report:
        style = fit_parents(style, n, processes=processes, progress=report)
    save_surface_style(style, folder)
    gap = find_gap(style)
    if gap is not None:
        console.tell(f"mbstudio: {gap}")
    errors = [entry.rms for entry in style.avatars]
    summary = {
        "style": str(folder),
        "preset": "surfaces",
        "parents": len(style.parents),
        "control_points": len(style.avatars[0].avatar.weights),
        "warps": len(style.modes),
        "avatars_rms_percent_of_dn": 100 * sum(errors) / len(errors),
        "invalid_avatars": int(sum(not entry.valid for entry in style.avatars)),
        "seconds": round(time.monotonic() - begun, 1),
    }
    if as_json:
        console.print_json(summary)
    else:
        console.print_facts(f"Style of {title}", summary)


def _mesh_of(avatar: Any) -> Any:
    mesh = avatar.mesh(cells=64)
    mesh.units = avatar.unit
    return mesh


def generate_surface_clones(
    style_folder: Path, folder: Path, count: int, seed: int, where: list[str],
    strengths: dict[str, float], unit: str | None, processes: int, *, overwrite: bool, as_json: bool,
) -> None:  # fmt: skip
    """Generate clones of a style of surfaces, write them into a folder and say how they came about."""
    from mbstudio.core.cloning.clone_maker import CloneOptions
    from mbstudio.core.cloning.surface_generation import generate_surfaces
    from mbstudio.core.cloning.surface_style_file import load_surface_style
    from mbstudio.core.dem.folder import check_replaceable
    from mbstudio.core.dem.manifest import files_of_earlier_export
    from mbstudio.core.errors import GenerationError

    begun = time.monotonic()
    options = CloneOptions.make(strengths)
    if folder.resolve() == style_folder.resolve():
        raise GenerationError(f"{folder} is the folder of the style: choose another folder for the clones.")
    check_replaceable(folder, files_of_earlier_export, overwrite)
    style = load_surface_style(style_folder)
    with keeping_results(folder):
        with console.progress("Generating") as tell:
            found = generate_surfaces(
                style, count, seed, options=options, targets=where, processes=processes, progress=tell
            )
        write_clones(found, folder, unit, overwrite)
    summary: dict[str, Any] = {
        "clones": len(found),
        "folder": str(folder),
        "seed": seed,
        "candidates": found.candidates,
        "chosen_by": found.how,
        "avatars_rms_percent_of_dn": 100 * float(_rms(found).mean()),
        "invalid_avatars": int(sum(not clone.fitted.valid for clone in found.clones if clone.fitted)),
        "seconds": round(time.monotonic() - begun, 1),
    }
    if as_json:
        console.print_json({**summary, "reached": [figure.as_record() for figure in found.reached]})
        return
    console.print_facts(f"Clones in the style of {style_folder.name}", summary)
    if found.reached:
        console.print_table(
            "Conditions", ("", "target", "found"), [(f.what, f.wanted, f.found) for f in found.reached]
        )


def surfaces_of_clones(folder: Path) -> list[Path] | None:
    """Return the surfaces of record of a folder of such clones; None of any other."""
    from mbstudio.core.cloning.clones_table import CLONES_TABLE
    from mbstudio.core.dem.manifest import FILE_NAME, read_manifest

    if not (folder / FILE_NAME).is_file():
        return None
    manifest = read_manifest(folder)
    found = [f"{item['name']}.ply" for item in manifest["items"]]
    if CLONES_TABLE not in manifest["files"] or not set(found) <= set(manifest["files"]):
        return None
    return [folder / name for name in found]


def _rms(found: SurfaceGeneration) -> pd.Series:
    from mbstudio.core.cloning.clones_table import clones_table

    return clones_table(found)["avatar_rms"]


def write_clones(
    found: SurfaceGeneration, folder: Path, unit: str | None, overwrite: bool,
    more: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """Write surfaces, metaballs and tables into a folder, and `more` files by name."""
    from trimesh.exchange.ply import export_ply

    from mbstudio.core.cloning.clones_table import CLONES_TABLE, clones_table
    from mbstudio.core.dem import export
    from mbstudio.core.units import conversion_factor

    names = [clone.name for clone in found.clones]
    table = found.factors.table()
    # A clone without factors keeps the reason beside its row.
    table = table.drop(columns=[name for name in ("warning", "not_measured") if not any(table[name])])
    table.insert(1, "name", names)
    files: dict[str, str | bytes] = {
        **(more or {}),
        FACTORS_TABLE: table.to_csv(index=False, lineterminator="\r\n"),
        CLONES_TABLE: clones_table(found).to_csv(index=False, lineterminator="\r\n"),
    }
    for clone in found.clones:
        mesh = clone.mesh()
        if unit:
            mesh.apply_scale(conversion_factor(clone.unit, unit))
        files[f"{clone.name}.ply"] = export_ply(mesh)
    with console.progress("Writing") as tell:
        export(
            found.avatars(), "metaball", folder, unit=unit, names=names, overwrite=overwrite, progress=tell,
            attachments=files, surfaces=found.meshes(),
        )  # fmt: skip
