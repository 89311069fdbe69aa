"""``mbstudio porosity``: pores of the segmented specimen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.laboratory.measured import SeedOption
from mbstudio.cli.measure import require_table_output
from mbstudio.core.errors import MbstudioError, MeasureError

if TYPE_CHECKING:
    from mbstudio.core.porosity import PorosityProfile, Specimen

HELP = """Measure the porosity of a project's specimen, its profiles and its representative volume.

Solid is every voxel of a grain, also of one that the border cuts; all else is pore. By default the specimen
is all that the scan has seen; --diameter takes a cylinder along z in its middle, such as one without the
mould's wall.
"""


def porosity(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")],
    diameter: Annotated[
        float | None,
        typer.Option("--diameter", metavar="LENGTH", help="Of a cylinder along z, in the scan's unit."),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance", min=0.001, max=0.5, help="Of the porosity of representative boxes, over it."
        ),
    ] = 0.05,
    seed: SeedOption = 0,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write profiles and boxes as CSV.")
    ] = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio porosity``; `HELP` says what it does."""
    from mbstudio.core.porosity import Specimen, porosity_profiles, representative_volume
    from mbstudio.core.project import Project

    require_table_output(csv_file, source)
    if not inputs.is_project(source):
        raise MbstudioError(f"{source} is no project (.mbs).")
    grains = Project.open(source).grains
    if grains is None:
        raise MeasureError(f"{source} has no grains yet: find them with 'mbstudio segment' first.")
    specimen: Specimen | None = None if diameter is None else Specimen.cylinder(grains, diameter)
    profiles = porosity_profiles(grains, specimen)
    boxes = representative_volume(grains, specimen, tolerance=tolerance, seed=seed)
    mean = profiles["z"].mean
    facts: dict[str, Any] = {
        "specimen": (specimen or Specimen.of_scan(grains)).words,
        "porosity": mean,
        "solid_fraction": 1 - mean,
        "void_ratio": mean / (1 - mean) if mean < 1 else float("inf"),
        "representative_edge": boxes.edge,
        "tolerance": tolerance,
        "unit": grains.unit,
    }
    if csv_file is not None:
        _write(csv_file, profiles, boxes)
    if as_json:
        console.print_json(
            {
                **facts, "seed": seed,
                "profiles": {
                    name: {"places": p.places, "porosity": p.porosity, "voxels": p.voxels}
                    for name, p in profiles.items()
                },
                "boxes": {
                    name: getattr(boxes, name) for name in ("edges", "mean", "deviation", "boxes")
                },
            }
        )  # fmt: skip
        return
    console.print_facts(f"Pores of {source.name}", facts)
    console.print_table(
        f"Boxes at random places, edges in {grains.unit}", ("edge", "boxes", "porosity", "s.d."),
        list(zip(boxes.edges.tolist(), boxes.boxes.tolist(), boxes.mean.tolist(), boxes.deviation.tolist(),
                 strict=True)),
    )  # fmt: skip
    if boxes.edge is None:
        print(
            "No representative volume: the porosity of boxes up to half of the specimen still differs by "
            f"more than {100 * tolerance:g} %."
        )


def _write(path: Path, profiles: dict[str, PorosityProfile], boxes: Any) -> None:
    import pandas as pd

    from mbstudio.cli.measuring import write_csv

    unit = boxes.unit
    parts = [
        pd.DataFrame({"along": name, f"place_{unit}": p.places, "porosity": p.porosity, "voxels": p.voxels})
        for name, p in profiles.items()
    ]
    parts.append(
        pd.DataFrame(
            {"along": "box edge", f"place_{unit}": boxes.edges, "porosity": boxes.mean,
             "deviation": boxes.deviation, "boxes": boxes.boxes}
        )
    )  # fmt: skip
    write_csv(path, pd.concat(parts))
