"""``mbstudio segment``: the grains of a scan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import MbstudioError

if TYPE_CHECKING:
    from mbstudio.core.project import Project

HELP = "Find the grains of a scan."


def segment(
    source: Annotated[Path, typer.Argument(metavar="SCAN|PROJECT", help="A scan, or a project with a scan.")],
    voxel_size: inputs.VoxelSizeOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Project file to write.")
    ] = None,
    write_labels: Annotated[
        Path | None,
        typer.Option(
            "--write-labels", metavar="FILE", help="Also write the label image (TIFF, NRRD, MHA, OME-Zarr)."
        ),
    ] = None,
    labels: inputs.LabelsOption = None,
    splitting: inputs.SplittingOption = None,
    smallest: inputs.SmallestOption = None,
    threshold: inputs.ThresholdOption = None,
    dark: inputs.DarkOption = None,
    classifier: inputs.ClassifierOption = None,
    scan: inputs.ScanOption = None,
    shape: inputs.ShapeOption = None,
    dtype: inputs.DtypeOption = None,
    header_bytes: inputs.HeaderOption = 0,
    big_endian: inputs.EndianOption = False,
    crop: inputs.CropOption = None,
    binning: inputs.BinOption = None,
    anyway: inputs.AnywayOption = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio segment``; `HELP` says what it does."""
    from mbstudio.core.grains.label_writing import write_label_image
    from mbstudio.core.project import Project

    if write_labels is not None:
        _require_label_output(write_labels, source)
    if output is not None:
        inputs.require_project_output(output)
    inputs.require_scan_to_crop(source, crop, binning)
    if inputs.is_project(source):
        project = Project.open(source)
        if scan is not None:
            project.relocate_scan(scan)
    else:
        project = Project.new(
            inputs.open_input_scan(source, voxel_size, shape, dtype, header_bytes, big_endian, crop, binning)
        )
    with project:
        if output is not None:
            project.hold("mbstudio segment", output)
        grains = inputs.find_grains(
            project,
            labels,
            inputs.segmentation_options(splitting, smallest, threshold, dark),
            anyway,
            classifier,
        )
        result = {**describe_grains(grains), **describe_part(project)}
        if write_labels is not None:
            write_label_image(write_labels, grains, project.scan.grid if project.scan is not None else None)
            result["labels"] = str(write_labels)
        if output is not None:
            result["project"] = str(inputs.save_results(project, output))
    verdict = grains.verdict
    if as_json:
        console.print_json({**result, "verdict": verdict.to_record() if verdict is not None else None})
        return
    if verdict is not None:
        result["phases"], result["field_of_view"] = verdict.phases or None, verdict.view
        result["verdict"] = verdict.level
    console.print_facts(f"Grains of {source.name}", result)


def describe_grains(grains: Any) -> dict[str, Any]:
    """Return how many grains there are, and how large."""
    import numpy as np

    from mbstudio.core.formulas import nominal_diameters

    diameters = nominal_diameters(grains.table["volume"].to_numpy())
    return {
        "grains": len(grains),
        "interior": len(grains.interior_labels),
        "solid_fraction": float(np.count_nonzero(grains.labels) / grains.labels.size),
        "median_dn": float(np.median(diameters)) if len(grains) else None,
        "unit": grains.unit,
    }


def describe_part(project: Project) -> dict[str, Any]:
    """Return which part of its file the scan of a project is, nothing where it is all of it."""
    reference = project.state.scan
    if reference is None or reference.excerpt is None:
        return {}
    return {"part": reference.excerpt.describe(), "voxel_size": str(reference.voxel_size)}


def _require_label_output(path: Path, source: Path) -> None:
    """Refuse a label image that would replace the scan, or has an ending of no format, before the work."""
    from mbstudio.core.grains.label_writing import require_ending

    if path.resolve() == source.resolve():
        raise MbstudioError(f"{path} is the scan itself: give the label image another name.")
    require_ending(path)
