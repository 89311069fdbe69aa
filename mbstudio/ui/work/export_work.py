"""Writing DEM files in the background."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mbstudio.core.dem import export
from mbstudio.core.units import unit_label
from mbstudio.ui.work.work import Work
from mbstudio.ui.workers import Control, Task


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
                **options,
            )

        task = Task(f"Exporting {len(avatars)} avatar{'s' if len(avatars) != 1 else ''}", work)
        task.succeeded.connect(lambda report: self._tell(report, len(avatars), unit))
        return self.queue.submit(task)

    def _tell(self, report: Any, count: int, unit: str | None) -> None:
        lengths = f" in {unit_label(unit)}" if unit else ""
        avatars = f"{count} avatar{'s' if count != 1 else ''}"
        wrote = (
            f"Wrote {avatars}{lengths} as {len(report.files)} files to {report.folder}; each was read back."
        )
        if report.warnings:
            further = f" (and {len(report.warnings) - 1} more)" if len(report.warnings) > 1 else ""
            self.said.emit("warning", f"{wrote} {report.warnings[0]}{further}")
        else:
            self.said.emit("success", wrote)
