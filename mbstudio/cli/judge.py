"""``mbstudio judge``: whether clones can be told from true grains."""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.measure import require_table_output
from mbstudio.cli.surfaces import surfaces_of_clones
from mbstudio.core.cloning.clones_table import CLONES_TABLE
from mbstudio.core.errors import MbstudioError

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains.grain import Grain
    from mbstudio.core.judging.features import Features
    from mbstudio.core.judging.judgement import Judgement
    from mbstudio.core.metaball.avatar import Avatar

    Body = Grain | Avatar | trimesh.Trimesh

HELP = """Judge whether clones can be told from true grains, by features that no generator selects on.

Clones, true grains and fits are meshes, folders of them, a project, or a folder that 'mbstudio generate'
or 'mbstudio export --to metaball' wrote. Of a project --against takes the grains, all others the avatars.
Fits belong to the grain of the same name. Of clones from surfaces the surfaces are judged, with the metaballs
as their fits and clones.csv as the table of their parents.
"""
_NAME, _PARENT = "name", "parent"


def judge(
    clones: Annotated[list[Path], typer.Argument(metavar="CLONES...", help="The clones to be judged.")],
    against: Annotated[
        list[Path],
        typer.Option("--against", metavar="GRAINS", help="The true grains; repeat for more meshes."),
    ],
    fits: Annotated[
        Path | None,
        typer.Option("--fits", metavar="FITS", help="Avatars fitted to the true grains."),
    ] = None,
    clone_fits: Annotated[
        Path | None, typer.Option("--clone-fits", metavar="FITS", help="Avatars fitted to the clones.")
    ] = None,
    parents: Annotated[
        Path | None,
        typer.Option(
            "--parents", metavar="TABLE",
            help="CSV file with the columns 'name' and 'parent' of every clone.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Report as an HTML file.")
    ] = None,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Table of all areas as a CSV file.")
    ] = None,
    drift_file: Annotated[
        Path | None, typer.Option("--drift", metavar="FILE", help="Table of all drifts as a CSV file.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same numbers.")] = 0,
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:  # fmt: skip
    """Run ``mbstudio judge``; `HELP` says what it does."""
    from mbstudio.core.judging.judging import judge as judge_clones

    begun = time.monotonic()
    for path in (output, csv_file, drift_file):
        require_table_output(path, clones[0])
    true = _named_bodies(against, grains=True)
    surfaces = surfaces_of_clones(clones[0]) if len(clones) == 1 else None
    if surfaces is None:
        made = _named_bodies(clones)
    else:
        made = _named_bodies(surfaces)
        clone_fits, parents = clone_fits or clones[0], parents or clones[0] / CLONES_TABLE
    groups = None if parents is None else _parents_of(parents, list(made))
    fitted = None if fits is None else _named_bodies([fits])
    remade = None if clone_fits is None else _named_bodies([clone_fits])
    grains, bodies = _measured(true, "true grains", workers), _measured(made, "clones", workers)
    with console.progress("Judging") as tell:
        found = judge_clones(
            list(grains.values()), list(bodies.values()),
            true_groups=list(grains),
            clone_parents=None if groups is None else [groups[name] for name in bodies],
            fits_of_true=_fits_of(fitted, list(grains), "true grains", workers),
            fits_of_clones=_fits_of(remade, list(bodies), "clones", workers), seed=seed, progress=tell,
        )  # fmt: skip
    _write(
        found, output, csv_file, drift_file, [true[name] for name in grains], [made[name] for name in bodies]
    )
    if as_json:
        console.print_json(found.as_dict())
        return
    _print(found, {"report": output, "seconds": round(time.monotonic() - begun, 1)})


def _named_bodies(sources: Sequence[Path], grains: bool = False) -> dict[str, Body]:
    """Return bodies by their names.

    Raises
    ------
    MbstudioError
        If there are none, or two of one name.
    """
    from mbstudio.core.dem.manifest import files_of_earlier_export

    if len(sources) == 1 and inputs.is_project(sources[0]):
        return _bodies_of_project(sources[0], grains)
    if len(sources) == 1 and sources[0].is_dir() and files_of_earlier_export(sources[0]) is not None:
        exported = _bodies_of_export(sources[0])
        if exported is not None:
            return exported
    meshes = inputs.meshes_among(sources)
    if meshes is None:
        if not sources[0].exists():
            raise MbstudioError(f"{sources[0]} does not exist: check the name and the folder.")
        raise MbstudioError(
            f"{sources[0]} is neither a mesh or a folder of meshes, nor a project, nor a folder of exported "
            "avatars."
        )
    named: dict[str, Body] = {}
    for body in inputs.bodies_of_meshes(meshes, None, "fill", None, None):
        name = str(body.metadata["name"])
        if name in named:
            raise MbstudioError(
                f"Two bodies are called '{name}': rename a file, so that each has a name of its own."
            )
        named[name] = body
    return named


def _bodies_of_project(path: Path, grains: bool) -> dict[str, Body]:
    from mbstudio.core.project import Project

    project = Project.open(path)
    if project.grains is None:
        raise MbstudioError(f"{path} has no grains yet: find them with 'mbstudio segment' first.")
    labels = project.grains.interior_labels if grains else list(project.state.included_fits)
    if not labels:
        wanted = "grains inside the field of view" if grains else "avatars: fit some with 'mbstudio fit'"
        raise MbstudioError(f"{path} has no {wanted}.")
    names = {
        label: project.grains.name_of(label) if project.grains.is_of_meshes else str(label)
        for label in labels
    }
    return {
        names[label]: project.grains.body(label) if grains else project.fits[label].avatar for label in labels
    }


def _bodies_of_export(folder: Path) -> dict[str, Body] | None:
    """Return the avatars of an export; None where it holds none."""
    from mbstudio.core.dem.formats.metaball import read_metaball
    from mbstudio.core.dem.manifest import read_manifest

    manifest = read_manifest(folder)
    if manifest["target"] != "metaball":
        return None
    return {
        str(item["name"]): read_metaball(
            folder / next(name for name in item["files"] if name.endswith(".json"))
        )
        for item in manifest["items"]
    }


def _parents_of(path: Path, clones: Sequence[str]) -> dict[str, str]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.DictReader(lines))
    except UnicodeDecodeError as error:
        raise MbstudioError(f"{path} is not a text file in UTF-8: save it as CSV again.") from error
    if not rows or _NAME not in rows[0] or _PARENT not in rows[0]:
        raise MbstudioError(f"{path} must have the columns '{_NAME}' and '{_PARENT}', one row a clone.")
    known = {str(row[_NAME]): str(row[_PARENT]) for row in rows}
    missing = [name for name in clones if not known.get(name)]
    if missing:
        raise MbstudioError(
            f"{path} states no parent of {len(missing)} of {len(clones)} clones, the first '{missing[0]}': "
            "give one for each."
        )
    return known


def _measured(bodies: dict[str, Body], words: str, workers: int | None) -> dict[str, Features]:
    """Return the features of bodies; those that have none are told and left out."""
    from mbstudio.core.judging.measuring import measure_features

    with console.progress(f"Measuring {words}") as tell:
        found = measure_features(list(bodies.values()), workers=workers, progress=tell)
    kept: dict[str, Features] = {}
    for name, features in zip(bodies, found, strict=True):
        if isinstance(features, str):
            console.tell(f"mbstudio: left out: {name}: {features}")
        else:
            kept[name] = features
    return kept


def _fits_of(
    fits: dict[str, Body] | None, names: Sequence[str], words: str, workers: int | None
) -> list[Features | None] | None:
    if fits is None:
        return None
    paired = {name: fits[name] for name in names if name in fits}
    if not paired:
        raise MbstudioError(
            f"None of the fits has the name of one of the {words}, as '{names[0]}': fits belong to bodies by "
            "name."
        )
    measured = _measured(paired, f"fits of {words}", workers)
    return [measured.get(name) for name in names]


def _write(
    found: Judgement, output: Path | None, csv_file: Path | None, drift_file: Path | None,
    true: Sequence[Body], clones: Sequence[Body],
) -> None:  # fmt: skip
    from mbstudio.cli.measuring import write_csv

    if csv_file is not None:
        write_csv(csv_file, found.table())
    if drift_file is not None:
        write_csv(drift_file, found.drift_table())
    if output is not None:
        from mbstudio.core.judging.measuring import surface_of
        from mbstudio.scene.reports.judgement_report import write_judgement_report

        with console.progress("Drawing") as tell:
            surfaces = [[surface_of(body) for body in bodies] for bodies in (true, clones)]
            write_judgement_report(
                output, "Clones judged against true grains", found, *surfaces, progress=tell
            )


def _print(found: Judgement, facts: dict[str, Any]) -> None:
    from mbstudio.scene.reports.judgement_report import area_words, chance_words, verdict_of

    for comparison in found.comparisons:
        rows = [
            (
                result.features, area_words(result.logistic), chance_words(result.logistic),
                area_words(result.forest), chance_words(result.forest), result.verdict,
            )
            for result in comparison.results
        ]  # fmt: skip
        console.print_table(
            f"{comparison.title} ({comparison.numbers[0]}, {comparison.numbers[1]})",
            ("area under the ROC curve", "logistic", "chance", "forest", "chance", ""), rows,
        )  # fmt: skip
    drifted = sorted(found.drifts, key=lambda row: -abs(row.drift))[:8]
    console.print_table(
        "What has drifted most, in standard deviations of true grains",
        ("", "drift", "error", "K-S", "of halves"),
        [(row.feature, row.drift, row.error, row.ks, row.ks_floor[0]) for row in drifted],
    )  # fmt: skip
    near = found.likeness
    console.print_facts("How new they are", {
        "nearest of true grains": near.distance[0], "nearest of clones": near.distance[1],
        "correlation of true grains": near.correlation[0], "correlation of clones": near.correlation[1],
        "correlation with own parent": near.source_correlation, "copies percent": 100 * near.copies,
    })  # fmt: skip
    for note in found.notes:
        console.tell(note)
    console.print_facts(verdict_of(found), {key: value for key, value in facts.items() if value is not None})
