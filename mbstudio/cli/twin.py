"""``mbstudio twin``: all avatars of a scan fitted together to its grey values, and their contacts."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.fit import NOption, SeedOption
from mbstudio.core.errors import MbstudioError, TwinError

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.project import Project
    from mbstudio.core.twin.fabric import Fabric
    from mbstudio.core.twin.result import TwinResult

HELP = """Fit all avatars of a project together to the grey values of its scan, and find their contacts.

Avatars that the project has are where it starts; other grains are fitted to their labels first. Those that
the border does not cut are kept in the project, and the contacts in a table beside it. With --labels nothing
is fitted: the contacts are those that the labels show.
"""


def twin(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with its scan and grains.")],
    n: NOption = 40,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Project file; by default saved in place."),
    ] = None,
    contacts: Annotated[
        Path | None,
        typer.Option("--contacts", metavar="FILE", help="CSV table; by default PROJECT-contacts.csv."),
    ] = None,
    network: Annotated[
        Path | None,
        typer.Option("--network", metavar="FILE", help="Write the contact network: .graphml or .vtu."),
    ] = None,
    labels: Annotated[
        bool, typer.Option("--labels", help="Take the contacts from the labels, and fit nothing.")
    ] = False,
    sweeps: Annotated[int, typer.Option("--sweeps", min=1, help="Sweeps over all grains.")] = 4,
    seed: SeedOption = 0,
    workers: inputs.WorkersOption = None,
    scan: inputs.ScanOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio twin``; `HELP` says what it does."""
    from mbstudio.core.project import Project

    begun = time.monotonic()
    if not inputs.is_project(source):
        raise MbstudioError(f"{source} is no project: make one with 'mbstudio segment' or 'mbstudio fit'.")
    output = inputs.require_project_output(output) if output is not None else source
    contacts = contacts or output.with_name(f"{output.stem}-contacts.csv")
    _require_folders(contacts, network)
    with Project.open(source) as project:
        if scan is not None:
            project.relocate_scan(scan)
        if project.grains is None:
            raise TwinError(f"{source} has no grains: find them first with 'mbstudio segment {source}'.")
        if labels:
            facts, table, middles = _of_labels(project)
        else:
            project.hold("mbstudio twin", output)
            found = _fit(project, n, sweeps, seed, workers)
            facts, table, middles = _of_twin(found), found.contacts, found.middles()
            project.add_fits(found.fits(project.grains), "Fit the twin", found.kept())
            inputs.save_results(project, output)
            facts["project"] = str(output)
        unit = project.grains.unit
    _write(table, middles, unit, contacts, network)
    facts |= {"contacts_file": str(contacts), "seconds": round(time.monotonic() - begun, 1)}
    if as_json:
        console.print_json(facts)
    else:
        console.print_facts(f"{'Contacts of the labels' if labels else 'Twin'} of {source}", facts)


def _require_folders(*paths: Path | None) -> None:
    """Refuse outputs that cannot be written, before the work begins."""
    from mbstudio.core.twin.network_files import ENDINGS

    for path in paths:
        if path is not None and not path.resolve().parent.is_dir():
            raise MbstudioError(f"{path} cannot be written: the folder {path.parent} does not exist.")
    network = paths[-1]
    if network is not None and network.suffix.lower() not in ENDINGS:
        raise MbstudioError(f"{network} is no file of a network: name it *.graphml or *.vtu.")


def _fit(project: Project, n: int, sweeps: int, seed: int, workers: int | None) -> TwinResult:
    from mbstudio.core.twin.twinning import start_twin

    assert project.grains is not None
    changed = project.state.changed_labels
    known = {label: fit for label, fit in project.fits.items() if label not in changed}
    run = start_twin(project.scan, project.grains, known, n, seed=seed, sweeps=sweeps, workers=workers)
    with console.progress("Fitting the twin") as report:
        for step in run:
            told = f"sweep {step.sweep} of {step.sweeps}, misfit {step.misfit:.4f}"
            report(step.done, told if step.sweep else "fitting grains to their labels")
    return run.result()


def _of_twin(found: TwinResult) -> dict[str, Any]:
    levels, rows = found.levels, found.residuals
    facts: dict[str, Any] = {
        "grains": len(rows),
        "cut_by_the_border": int(rows["touches_border"].sum()),
        "converged": int(rows["converged"].sum()),
        "blur": f"{found.blur:.4g} {found.unit}",
        "tones": levels.tone_model,
        "void_level": levels.void_model,
        "noise_percent_of_contrast": 100 * levels.grain_noise / abs(levels.contrast),
        "misfit_before_percent": 100 * found.misfit_before,
        "misfit_percent": 100 * found.misfit,
    }
    if levels.notes:
        facts["mind"] = list(levels.notes)
    touching = found.contacts["probability"] >= 0.5
    return facts | (_told(found.fabric()) if touching.any() else {"contacts": 0})


def _of_labels(project: Project) -> tuple[dict[str, Any], pd.DataFrame, dict[int, Any]]:
    from mbstudio.core.twin.fabric import measure_fabric
    from mbstudio.core.twin.label_contacts import contacts_of_labels

    grains = project.grains
    assert grains is not None
    if grains.is_of_meshes:
        raise TwinError("These grains are meshes, each by itself: they have no contacts.")
    table, rows = contacts_of_labels(grains), grains.table
    labels = [int(label) for label in rows["label"]]
    places = rows[["x", "y", "z"]].to_numpy(float)
    cut = frozenset(int(label) for label in rows.loc[rows["touches_border"], "label"])
    facts: dict[str, Any] = {"grains": len(rows), "cut_by_the_border": len(cut)}
    facts |= _told(measure_fabric(table, labels, cut)) if len(table) else {"contacts": 0}
    return facts, table, dict(zip(labels, places, strict=True))


def _told(fabric: Fabric) -> dict[str, Any]:
    return {
        "contacts": fabric.contacts,
        "mean_coordination": fabric.mean_coordination,
        "anisotropy_of_normals": fabric.normal.anisotropy,
        "anisotropy_of_normals_95_percent": list(fabric.normal.anisotropy_interval),
        "anisotropy_of_branches": fabric.branch.anisotropy,
    }


def _write(
    table: pd.DataFrame, middles: dict[int, Any], unit: str, contacts: Path, network: Path | None
) -> None:
    from mbstudio.core.twin.contact_files import write_contact_network, write_contact_table

    write_contact_table(contacts, table, unit)
    if network is not None:
        write_contact_network(network, table, middles, unit)
