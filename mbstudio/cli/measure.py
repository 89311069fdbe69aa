"""``mbstudio measure``: shape factors of grains, avatars and meshes."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.measuring import FACTORS, measure_grains
from mbstudio.core.errors import MbstudioError, MeasureError

ROWS_ON_SCREEN = 20


def measure(
    source: Annotated[
        Path, typer.Argument(metavar="PROJECT|MESH", help="A project with grains, or a closed surface mesh.")
    ],
    grains: Annotated[
        str | None, typer.Option("--grains", metavar="3,5,9", help="Only these labels (1-20 is a range).")
    ] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="Only so many grains.")] = None,
    unit: inputs.UnitOption = None,
    workers: inputs.WorkersOption = None,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write one row a grain as CSV.")
    ] = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Measure shape factors: of a mesh, or of a project's grains and their avatars.

    Of a project, the grains that have an avatar are measured together with it, with the
    relative error of each factor; if none has one, all interior grains.
    """
    if csv_file is not None and csv_file.resolve() == source.resolve():
        raise MbstudioError(f"{csv_file} is the file to be measured: give the table another name.")
    if inputs.is_mesh(source):
        _measure_mesh(source, unit, csv_file, as_json)
        return
    if not inputs.is_project(source):
        raise MbstudioError(f"{source} is neither a project (.mbs) nor a mesh (.stl, .ply, .obj, .off).")
    from mbstudio.core.project import Project

    project = Project.open(source)
    if project.grains is None:
        raise MeasureError(f"{source} holds no grains yet: find them with 'mbstudio segment' first.")
    labels = inputs.numbers_in(grains, "--grains") or sorted(project.fits) or project.grains.interior_labels
    rows, failures = measure_grains(project, labels[:limit], unit, workers)
    if csv_file is not None:
        write_csv(csv_file, rows)
    summary = summarise(rows)
    if as_json:
        console.print_json({"grains": rows, "summary": summary, "failures": failures})
    else:
        _print_rows(source, rows, summary)
    for label, reason in list(failures.items())[:5]:
        console.tell(f"mbstudio: grain {label} could not be measured: {reason}")
    if not rows:
        raise MeasureError(f"No grain of {source} could be measured.")


def _measure_mesh(source: Path, unit: str | None, csv_file: Path | None, as_json: bool) -> None:
    import trimesh

    from mbstudio.core.metrics import measure as measure_body

    if not source.is_file():
        raise MbstudioError(f"{source} is not there: check the name and the folder.")
    try:
        mesh: Any = trimesh.load(source, force="mesh")
        factors = measure_body(mesh, unit=unit).as_dict()
    except MbstudioError as error:
        raise type(error)(f"{source}: {error}") from error
    except (ValueError, IndexError, KeyError, TypeError) as error:  # trimesh's readers let these through
        raise MeasureError(f"{source} cannot be read as a mesh ({error}): export it again.") from error
    if csv_file is not None:
        write_csv(csv_file, [{"name": source.name, **factors}])
    if as_json:
        console.print_json({"name": source.name, **factors})
    else:
        console.print_facts(f"Shape factors of {source.name}", factors)


def summarise(rows: list[dict[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Return medians over the grains: of the grains, of the avatars, and of the absolute error."""
    import numpy as np

    def median(key: str, name: str) -> float | None:
        values = [abs(row[key][name]) for row in rows if key in row]
        return float(np.median(values)) if values else None

    return {
        name: {
            "grain": median("grain", name),
            "avatar": median("avatar", name),
            "error": median("relative_error", name),
        }
        for name in FACTORS
    }


def _print_rows(
    source: Path, rows: list[dict[str, Any]], summary: dict[str, dict[str, float | None]]
) -> None:
    shown = ("volume", "sphericity", "circularity", "csf", "dns")
    table = [[row["label"], *(_with_error(row, name) for name in shown)] for row in rows[:ROWS_ON_SCREEN]]
    if table:
        headings = ["grain", *(f"{name} (avatar)" if "avatar" in rows[0] else name for name in shown)]
        console.print_table(f"Grains of {source.name}, lengths in {rows[0]['unit']}", headings, table)
    if len(rows) > ROWS_ON_SCREEN:
        print(f"... and {len(rows) - ROWS_ON_SCREEN} more: write them all with --csv FILE")
    medians = [
        [
            name,
            item["grain"],
            item["avatar"],
            None if item["error"] is None else f"{100 * item['error']:.2f} %",
        ]
        for name, item in summary.items()
    ]
    console.print_table(f"Medians over {len(rows)} grains", ("", "grain", "avatar", "|error|"), medians)


def _with_error(row: dict[str, Any], name: str) -> str:
    cell = f"{row['grain'][name]:.4g}"
    return f"{cell} ({100 * row['relative_error'][name]:+.1f} %)" if "relative_error" in row else cell


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write rows, factors of the avatar and errors in columns of their own."""
    from mbstudio.core.project.replacement import replacing

    flat = []
    for row in rows:
        cells: dict[str, Any] = {}
        for key, value in row.items():
            if isinstance(value, dict):
                cells.update({f"{key}_{name}": number for name, number in value.items()})
            else:
                cells[key] = value
        flat.append(cells)
    columns = list(dict.fromkeys(name for cells in flat for name in cells))
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        writer.writerows(flat)
