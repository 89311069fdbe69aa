"""What the commands of a laboratory share: the grains of a project measured, and counts for the border."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli.measure import chosen_grains
from mbstudio.core.errors import MeasureError

if TYPE_CHECKING:
    import numpy as np

    from mbstudio.core.project import Project
    from mbstudio.core.project.measuring import ProjectPopulations

PrecisionOption = Annotated[
    float,
    typer.Option(
        "--precision",
        min=0.001,
        max=0.5,
        help="Wanted half width of an interval over the value: 0.05 is 5 %.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of drawing again.")]
LaboratoryOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--laboratory", metavar="CSV", help="Table of a sieve analysis or Camsizer; may be repeated."
    ),
]
BorderOption = Annotated[
    bool,
    typer.Option("--border", help="Count grains inside for those that the border cuts (Miles-Lantuéjoul)."),
]


def measured_project(
    source: Path, grains: str | None, limit: int | None, unit: str | None, **how: Any
) -> tuple[Project, ProjectPopulations]:
    """Open a project and measure its grains; refuse it where none could be."""
    from mbstudio.cli.measuring import measure_grains

    project, labels = chosen_grains(source, grains, limit)
    found = measure_grains(project, labels, unit=unit, **how)
    if not found.grains.measured.any():
        raise MeasureError(f"No grain of {source} could be measured: 'mbstudio measure' says why.")
    return project, found


def counts_for_border(project: Project, found: ProjectPopulations) -> np.ndarray:
    """Return how many grains each stands for."""
    from mbstudio.core.populations.border import border_weights

    assert project.grains is not None
    return border_weights(project.grains, found.grains.labels.tolist())
