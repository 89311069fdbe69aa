"""Writing DEM files in the background."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem import export
from mbstudio.core.units import unit_label
from mbstudio.ui.work.work import Work
from mbstudio.ui.workers import Control, Task

if TYPE_CHECKING:
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.vae.latent_recipe import Recipe
    from mbstudio.core.vae.style_learner import StyleLearner

RECIPES = "recipes.json"
"""Beside exported kept grains: how each was made."""


class ExportWork(Work):
    """Exports avatars."""

    def export(
        self,
        labels: list[int],
        target: str,
        folder: Path,
        *,
        unit: str | None,
        density: float | None,
        options: dict[str, Any],
        overwrite: bool = False,
    ) -> Task:
        """Write the avatars of these grains for a DEM engine."""
        fits = self.workspace.state.fits
        return self._submit(
            [fits[label].avatar for label in labels], [f"grain_{label:05d}" for label in labels], target,
            folder, unit, density, options, overwrite, {},
        )  # fmt: skip

    def export_kept(
        self,
        learner: StyleLearner,
        kept: list[Recipe],
        target: str,
        folder: Path,
        *,
        unit: str | None,
        density: float | None,
        options: dict[str, Any],
        overwrite: bool = False,
    ) -> Task:
        """Write grains kept in the latent studio, with their recipes beside them."""
        names = [recipe.name.replace(" ", "_") for recipe in kept]
        avatars = learner.decode(np.stack([recipe.vector for recipe in kept]), names=tuple(names)).avatars()
        recipes = json.dumps([recipe.as_record() for recipe in kept], indent=1)
        return self._submit(
            avatars, names, target, folder, unit, density, options, overwrite, {RECIPES: recipes}
        )

    def _submit(
        self,
        avatars: list[Avatar],
        names: list[str],
        target: str,
        folder: Path,
        unit: str | None,
        density: float | None,
        options: dict[str, Any],
        overwrite: bool,
        attachments: dict[str, str],
    ) -> Task:
        def work(control: Control) -> Any:
            return export(
                avatars,
                target,
                folder,
                density=density,
                unit=unit,
                names=names,
                overwrite=overwrite,
                progress=control.progress,
                attachments=attachments,
                **options,
            )

        task = Task(f"Exporting {len(avatars)} avatar{'s' if len(avatars) != 1 else ''}", work)
        task.succeeded.connect(lambda report: self._tell(report, len(avatars), unit))
        return self.queue.submit(task)

    def _tell(self, report: Any, count: int, unit: str | None) -> None:
        lengths = f" in {unit_label(unit)}" if unit else ""
        avatars = f"{count} avatar{'s' if count != 1 else ''}"
        self.said.emit(
            "success",
            f"Wrote {avatars}{lengths} as {len(report.files)} files to {report.folder}; each was read back.",
        )
