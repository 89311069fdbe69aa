"""The grains and avatars of a project, measured as populations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.bodies import VoxelSurface
from mbstudio.core.metrics.measuring import AxisConvention
from mbstudio.core.populations.measuring import (
    Bodies,
    Known,
    Progress,
    given_body,
    grain_makers,
    measure_together,
)
from mbstudio.core.populations.population import Population
from mbstudio.core.project.project import Project


@dataclass(frozen=True, eq=False)
class ProjectPopulations:
    """The grains of a project and, of those that have one, their avatars.

    Attributes
    ----------
    grains : Population
    avatars : Population or None
        By the labels of their grains; None if no chosen grain has an avatar.
    """

    grains: Population
    avatars: Population | None


def measure_project(
    project: Project,
    labels: Sequence[int] | None = None,
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    detail: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
    known: Known | None = None,
) -> ProjectPopulations:
    """Measure a project's grains, and the avatars of those that have one, in one batch.

    Parameters
    ----------
    project : Project
    labels : sequence of int, optional
        Which grains; those with an avatar by default, all interior grains if none has one.
    unit, axes, surface, detail, workers, progress
        As for :func:`~mbstudio.core.populations.measuring.measure_population`.
    known : mutable mapping, optional
        As for :func:`~mbstudio.core.populations.measuring.measure_together`: grains by their set and label,
        avatars by themselves.

    Raises
    ------
    MeasureError, GrainError, UnitError
        As `measure_population`; MeasureError also if the project holds no grains.
    """
    grains = project.grains
    if grains is None:
        raise MeasureError("The project has no grains yet: find them with 'mbstudio segment' first.")
    groups = bodies_of(project, labels)
    measured = measure_together(
        groups, unit=unit or grains.unit, axes=axes, surface=surface, detail=detail,
        workers=workers, progress=progress, known=known,
    )  # fmt: skip
    return ProjectPopulations(measured[0], measured[1] if len(measured) > 1 else None)


def bodies_of(project: Project, labels: Sequence[int] | None = None) -> list[Bodies]:
    """Return what `measure_project` measures; nothing of a project without grains."""
    grains = project.grains
    if grains is None:
        return []
    chosen = [int(label) for label in (labels or project.state.included_fits or grains.interior_labels)]
    fitted = [label for label in chosen if label in project.fits]
    keys = [grains.body_key(label) for label in chosen]
    groups = [Bodies("grains", "grains", chosen, grain_makers(grains, chosen), keys)]
    if fitted:
        avatars = [project.fits[label].avatar for label in fitted]
        groups.append(Bodies("avatars", "avatars", fitted, [given_body(one) for one in avatars], avatars))
    return groups
