"""Writing DEM files in the background."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.cloning.clones_table import CLONES_TABLE, clones_table
from mbstudio.core.cloning.surface_generation import SurfaceGeneration
from mbstudio.core.dem import export
from mbstudio.core.units import unit_label
from mbstudio.core.vae.shaping.kept_grain import prepare_export
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task

if TYPE_CHECKING:
    from mbstudio.core.imaging import FitResult
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.populations import Population
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain

_COUNTED = {
    "avatar": (mark("1 avatar"), mark("{n} avatars")),
    "clone": (mark("1 clone"), mark("{n} clones")),
    "kept grain": (mark("1 kept grain"), mark("{n} kept grains")),
}


@dataclass(frozen=True, eq=False)
class ChosenAvatars:
    """Avatars that are to be exported.

    Attributes
    ----------
    named : tuple of (str, Avatar)
        Each with the name of its file.
    what : {'avatar', 'clone', 'kept grain'}
        What they are.
    attachments : mapping of str to str
        Files that go with them.
    factors : Population or None
        Of the avatars, row by row, where they were measured when they were made.
    surfaces : SurfaceGeneration or None
        Clones with a surface of record, which targets of meshes may take.
    """

    named: tuple[tuple[str, Avatar], ...] = ()
    what: str = "avatar"
    attachments: Mapping[str, str] = field(default_factory=dict)
    factors: Population | None = None
    surfaces: SurfaceGeneration | None = None

    def __len__(self) -> int:
        return len(self.named)


def chosen_fits(fits: Mapping[int, FitResult], labels: Sequence[int]) -> ChosenAvatars:
    """Return the avatars of grains."""
    return ChosenAvatars(tuple((f"grain_{label:05d}", fits[label].avatar) for label in labels))


def chosen_clones(clones: Generation | SurfaceGeneration) -> ChosenAvatars:
    """Return clones, with the table of their factors; of surfaces also what each was made of."""
    attached: dict[str, str] = {}
    if clones.factors is not None:
        table = clones.factors.table()
        # A clone without factors keeps the reason beside its row.
        empty = [name for name in ("warning", "not_measured") if not any(table[name])]
        table = table.drop(columns=empty)
        table.insert(1, "name", list(clones.names))
        attached["factors.csv"] = table.to_csv(index=False, lineterminator="\r\n")
    if isinstance(clones, SurfaceGeneration):
        attached[CLONES_TABLE] = clones_table(clones).to_csv(index=False, lineterminator="\r\n")
    named = tuple(zip(clones.names, clones.avatars(), strict=True))
    surfaces = clones if isinstance(clones, SurfaceGeneration) else None
    return ChosenAvatars(named, "clone", attached, clones.factors, surfaces)


def chosen_kept(learner: StyleLearner, kept: Sequence[KeptGrain]) -> ChosenAvatars:
    """Return grains kept in the latent studio, with their recipes."""
    avatars, names, attached = prepare_export(learner, kept)
    return ChosenAvatars(tuple(zip(names, avatars, strict=True)), "kept grain", attached)


class ExportWork(Work):
    """Exports avatars."""

    def export(self, chosen: ChosenAvatars, target: str, folder: Path, given: Mapping[str, Any]) -> Task:
        """Write avatars for a DEM engine.

        Parameters
        ----------
        chosen : ChosenAvatars
        target : str
        folder : Path
        given : mapping
            Unit, density, overwrite, specimen, and under ``options`` the target's own.
        """
        one, many = _COUNTED[chosen.what]
        told = tr(one) if len(chosen) == 1 else tr(many, n=len(chosen))
        names = [name for name, _ in chosen.named]
        avatars = [avatar for _, avatar in chosen.named]
        plain = {key: value for key, value in given.items() if key != "options"}

        def work(control: Control) -> Any:
            surfaces = None if chosen.surfaces is None else chosen.surfaces.meshes()
            return export(
                avatars, target, folder, names=names, progress=control.progress,
                attachments=chosen.attachments, surfaces=surfaces, **plain, **given["options"],
            )  # fmt: skip

        task = Task(tr("Exporting {avatars}", avatars=told), work)
        task.succeeded.connect(lambda report: self._tell(report, told, given["unit"]))
        return self.queue.submit(task)

    def _tell(self, report: Any, avatars: str, unit: str | None) -> None:
        files, folder = len(report.files), report.folder
        if unit:
            wrote = tr(
                "Wrote {avatars} in {unit} as {files} files to {folder}; each was read back.",
                avatars=avatars,
                unit=unit_label(unit),
                files=files,
                folder=folder,
            )
        else:
            wrote = tr(
                "Wrote {avatars} as {files} files to {folder}; each was read back.",
                avatars=avatars,
                files=files,
                folder=folder,
            )
        told = [wrote, *map(str, report.warnings[:1])]
        if len(report.warnings) > 1:
            told.append(tr("(and {n} more)", n=len(report.warnings) - 1))
        self.said.emit("warning" if report.warnings else "success", " ".join(told))
