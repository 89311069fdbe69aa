"""What ``mbstudio measure`` does with meshes: one body in full, several as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mbstudio.cli import console
from mbstudio.core.errors import MeasureError

if TYPE_CHECKING:
    import pandas as pd
    import trimesh

    from mbstudio.core.populations import Population

ROWS_ON_SCREEN = 60
_SHOWN = ("volume", "sphericity", "circularity", "csf", "dns")


def measure_meshes(
    meshes: Sequence[Path], bodies: Sequence[trimesh.Trimesh], unit: str | None, **how: Any
) -> tuple[Population, list[str]]:
    """Return the shape factors of bodies of meshes, and their names; those that fail are told."""
    from mbstudio.core.populations import measure_population

    names = [str(body.metadata["file_name"]) for body in bodies]
    title = meshes[0].name if len(meshes) == 1 else f"{len(meshes)} meshes"
    if len(bodies) == 1:
        how = {**how, "workers": 0}
    found = measure_population(bodies, name=title, unit=unit, **how)
    for place, reason in found.failures.items():
        told = f"{names[place]}: {reason}"
        if len(bodies) == 1:
            raise MeasureError(told)
        console.tell(f"mbstudio: left out: {told}")
    if len(found.failures) == len(bodies):
        raise MeasureError(
            f"None of the {len(bodies)} bodies could be measured: the reasons are listed above."
        )
    return found, names


def table_of_meshes(measured: tuple[Population, list[str]]) -> pd.DataFrame:
    """Return one row a body."""
    found, names = measured
    table = found.table().drop(columns=["label"] if len(names) > 1 else ["label", "not_measured"])
    table.insert(0, "name", names)
    return table


def tell_meshes(measured: tuple[Population, list[str]], as_json: bool) -> None:
    """Print the factors of one body, or a table and the medians of several."""
    import numpy as np

    found, names = measured
    stated = {"unit": found.unit, "axes": found.axes, "surface": found.surface}
    rows = [
        {"name": name, **{key: float(column[place]) for key, column in found.factors.items()},
         "warning": found.warnings[place]}
        for place, name in enumerate(names) if found.measured[place]
    ]  # fmt: skip
    if len(names) == 1:
        name, warning = rows[0].pop("name"), rows[0].pop("warning")
        factors = {**rows[0], **stated, "warning": warning}
        if as_json:
            console.print_json({"name": name, **factors})
        else:
            console.print_facts(f"Shape factors of {name}", factors)
        return
    medians = {key: float(np.nanmedian(column[found.measured])) for key, column in found.factors.items()}
    failures = {names[place]: reason for place, reason in found.failures.items()}
    if as_json:
        console.print_json({**stated, "bodies": rows, "medians": medians, "failures": failures})
        return
    shown = [[row["name"], *(f"{row[key]:.4g}" for key in _SHOWN)] for row in rows[:ROWS_ON_SCREEN]]
    title = f"{len(rows)} bodies of {found.name}, lengths in {found.unit}, axes {found.axes}"
    console.print_table(title, ("body", *_SHOWN), shown)
    if len(rows) > ROWS_ON_SCREEN:
        typer.echo(f"... and {len(rows) - ROWS_ON_SCREEN} more: write them all with --csv FILE")
    console.print_table("Medians", ("", "body"), [[key, value] for key, value in medians.items()])
