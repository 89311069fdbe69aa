"""Writing DEM files in the background."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.dem import export
from mbstudio.core.units import unit_label
from mbstudio.core.vae.kept_grain import to_export
from mbstudio.ui.work.work import Work
from mbstudio.ui.workers import Control, Task

if TYPE_CHECKING:
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.vae.generation import Generation
    from mbstudio.core.vae.kept_grain import KeptGrain
    from mbstudio.core.vae.style_learner import StyleLearner


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
        avatars = [fits[label].avatar for label in labels]
        names = [f"grain_{label:05d}" for label in labels]
        return self._write(
            avatars, names, "avatar", target, folder, {},
            unit=unit, density=density, options=options, overwrite=overwrite,
        )  # fmt: skip

    def export_clones(
        self,
        clones: Generation,
        target: str,
        folder: Path,
        *,
        unit: str | None,
        density: float | None,
        options: dict[str, Any],
        overwrite: bool = False,
    ) -> Task:
        """Write clones for a DEM engine, with the table of their factors."""
        attached: dict[str, str] = {}
        if clones.factors is not None:
            table = clones.factors.table().drop(columns=["warning", "not_measured"])
            table.insert(1, "name", list(clones.clones.names))
            attached["factors.csv"] = table.to_csv(index=False, lineterminator="\r\n")
        return self._write(
            clones.avatars(), list(clones.clones.names), "clone", target, folder, attached,
            unit=unit, density=density, options=options, overwrite=overwrite,
        )  # fmt: skip

    def export_kept(
        self,
        learner: StyleLearner,
        kept: Sequence[KeptGrain],
        target: str,
        folder: Path,
        *,
        unit: str | None,
        density: float | None,
        options: dict[str, Any],
        overwrite: bool = False,
    ) -> Task:
        """Write grains kept in the latent studio, with their recipes beside them."""
        avatars, names, attached = to_export(learner, kept)
        return self._write(
            avatars, names, "kept grain", target, folder, attached,
            unit=unit, density=density, options=options, overwrite=overwrite,
        )  # fmt: skip

    def _write(
        self, avatars: list[Avatar], names: list[str], what: str, target: str, folder: Path,
        attachments: dict[str, str], *, unit: str | None, density: float | None, options: dict[str, Any],
        overwrite: bool,
    ) -> Task:  # fmt: skip
        def work(control: Control) -> Any:
            return export(
                avatars, target, folder, density=density, unit=unit, names=names, overwrite=overwrite,
                progress=control.progress, attachments=attachments, **options,
            )  # fmt: skip

        told = f"{len(avatars)} {what}{'s' if len(avatars) != 1 else ''}"
        task = Task(f"Exporting {told}", work)
        task.succeeded.connect(lambda report: self._tell(report, told, unit))
        return self.queue.submit(task)

    def _tell(self, report: Any, avatars: str, unit: str | None) -> None:
        lengths = f" in {unit_label(unit)}" if unit else ""
        wrote = (
            f"Wrote {avatars}{lengths} as {len(report.files)} files to {report.folder}; each was read back."
        )
        if report.warnings:
            further = f" (and {len(report.warnings) - 1} more)" if len(report.warnings) > 1 else ""
            self.said.emit("warning", f"{wrote} {report.warnings[0]}{further}")
        else:
            self.said.emit("success", wrote)
