"""What is told of fits: while one runs, of its avatar, and of many at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mbstudio.core.imaging import FitGoal, FitResult
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.ui.language import tr


def reaches_goals(fit: FitResult) -> bool:
    """Return whether a fit has reached the target that it was made for."""
    return bool(fit.target and fit.reached) and FitGoal.parse(fit.target).is_met(fit.reached)


def describe_fit(label: int, fit: FitResult) -> str:
    """Return what is told of the fit of one grain, without the warnings of its verdict."""
    verdict = fit.verdict
    if not verdict.valid:
        return tr("Grain {label}: {reasons}", label=label, reasons=" ".join(verdict.reasons))
    told = tr(
        "Grain {label}: valid avatar of {n} control points, volume {error:+.2f} %.",
        label=label,
        n=fit.avatar.n,
        error=100 * verdict.volume_error,
    )
    if fit.target and reaches_goals(fit):
        reached = FitGoal.parse(fit.target).describe(fit.reached)
        told = " ".join((told, tr("It reaches the goal: {figures}.", figures=reached)))
    return told


def describe_fits(fits: Mapping[int, FitResult], failed: Sequence[Any]) -> tuple[str, str]:
    """Return the level of a message on many fits, and what it says.

    Parameters
    ----------
    fits : mapping of int to FitResult
        By label.
    failed : sequence
        Items with ``label`` and ``error``.
    """
    bad = [label for label, fit in fits.items() if not fit.verdict.valid]
    told = [
        tr(
            "{fitted} grains fitted, {valid} of the avatars valid.",
            fitted=len(fits),
            valid=len(fits) - len(bad),
        )
    ]
    aimed = [fit for fit in fits.values() if fit.target]
    if aimed:
        reached = sum(reaches_goals(fit) for fit in aimed)
        told.append(tr("{reached} of {aimed} reach the goal.", reached=reached, aimed=len(aimed)))
    if bad:
        told.append(
            tr("Not valid: grain {labels}. More control points usually help.", labels=_list_labels(bad))
        )
    warned = [label for label, fit in fits.items() if fit.verdict.warnings]
    if warned:
        warnings = " ".join(fits[warned[0]].verdict.warnings)
        told.append(
            tr("With warnings: grain {labels}: {warnings}", labels=_list_labels(warned), warnings=warnings)
        )
    if failed:
        told.append(
            tr(
                "{count} could not be fitted: grain {label}: {error}",
                count=len(failed),
                label=failed[0].label,
                error=failed[0].error,
            )
        )
    return "warning" if bad or failed or warned else "success", " ".join(told)


def _list_labels(labels: list[int]) -> str:
    shown = ", ".join(str(label) for label in labels[:6])
    return shown if len(labels) <= 6 else tr("{labels} and {n} more", labels=shown, n=len(labels) - 6)


def progress_of_step(step: SearchStep) -> tuple[float, str]:
    """Return how much of a search is done, 0 to 1, and what it is at."""
    done = step.generation / max(step.generations, 1)
    if step.phase == "clustering":
        told = tr("Sphere {sphere} of {spheres}", sphere=step.generation, spheres=step.generations)
        return 0.15 * done, told
    told = tr(
        "Generation {generation} of at most {generations}",
        generation=step.generation,
        generations=step.generations,
    )
    return 0.15 + 0.85 * done, told


def progress_of_goal_step(step: SearchStep) -> tuple[float, str]:
    """Return what the search for a target's number is at.

    Nobody knows how many numbers a target takes: the bar only shows that work goes on.
    """
    number = step.note.partition(";")[0]
    if step.phase == "clustering":
        return -1.0, tr(
            "{number}, sphere {sphere} of {spheres}",
            number=number,
            sphere=step.generation,
            spheres=step.generations,
        )
    return -1.0, tr(
        "{number}, generation {generation} of at most {generations}",
        number=number,
        generation=step.generation,
        generations=step.generations,
    )
