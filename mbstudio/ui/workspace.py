"""What the window works on: the project, its opened scan and the grain that is chosen."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import QObject, QSettings, Signal

from mbstudio.core.errors import ProjectError, ProjectLockedError
from mbstudio.core.grains.editing import Edit, EditOutcome
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.solid_voxels import solid_as_scan
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.project import FitSettings, Project, ProjectState, ScanReference
from mbstudio.core.project.merging import Merge
from mbstudio.core.project.regraining import Regraining
from mbstudio.core.project.state import ScanIdentity
from mbstudio.core.project.voxel_size import VoxelSizeCorrection
from mbstudio.core.scan import Scan
from mbstudio.core.scan.voxel_blocks import in_memory_bytes
from mbstudio.core.units import VoxelSize
from mbstudio.ui.kept_settings import files_that_exist
from mbstudio.ui.language import tr

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.twin.kept_twin import KeptTwin
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner

log = logging.getLogger(__name__)

RECENT = 8
KEPT_BYTES = 256 << 20
"""Scans up to this size stay in memory while undo can bring them back."""


class Workspace(QObject):
    """The project and the selection, with a signal for each thing that can change.

    Parameters
    ----------
    settings : QSettings
        Keeps the recent files.

    Attributes
    ----------
    settings : QSettings
    scan_forgotten : signal
        Undo has brought back a scan that is to be read again.
    project : Project
    scan : Scan or None
        The opened scan of the present state; None also while its file is missing.
    selected : int or None
        Label of the grain looked at; one selection for table, view, panels and plots.
    chosen : frozenset of int
        Labels of all chosen grains, `selected` among them: brushing takes many at a time.
    clone : int or None
        The clone that is looked at, counted from 1.
    spare_journal : callable
        Returns where finished avatars are written that cannot lie beside the project's file; from any thread.
    """

    state_changed = Signal()
    scan_changed = Signal()
    scan_forgotten = Signal()
    grains_changed = Signal()
    fits_changed = Signal()
    settings_changed = Signal()
    style_changed = Signal()
    clones_changed = Signal()
    kept_changed = Signal()
    learning_changed = Signal()
    packing_changed = Signal()
    selection_changed = Signal()
    clone_changed = Signal()
    project_replaced = Signal()
    recent_changed = Signal()

    def __init__(self, settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.settings = settings
        self.project = Project.new()
        self.scan: Scan | None = None
        self.selected: int | None = None
        self.chosen: frozenset[int] = frozenset()
        self.clone: int | None = None
        self.spare_journal: Callable[[], Path | None] = lambda: None
        self._scans: dict[ScanIdentity, Scan] = {}
        self._solid: tuple[GrainSet, Scan] | None = None
        self._seen = self.project.state
        self._coalescing: str | None = None

    @property
    def state(self) -> ProjectState:
        return self.project.state

    @property
    def style(self) -> StyleLearner | None:
        """The style-learner that the stations Style and Latent work with; None before one is there."""
        return self.state.style

    @property
    def surfaces(self) -> SurfaceStyle | None:
        """The style of surfaces that stands in place of a style-learner; None where there is none."""
        return self.state.surfaces

    @property
    def has_style(self) -> bool:
        """Whether clones can be made: there is a style, of whichever kind."""
        return self.state.style is not None or self.state.surfaces is not None

    @property
    def clones(self) -> Generation | SurfaceGeneration | None:
        """The clones made last, of whichever style; None before there are any."""
        return self.state.new_grains

    @property
    def is_modified(self) -> bool:
        """Whether closing would lose something."""
        return self.project.is_modified

    @property
    def can_be_saved(self) -> bool:
        """Whether there is something that a project file is worth: a scan, grains, a style or kept grains."""
        state = self.state
        found = (state.scan, state.grains, state.style, state.surfaces)
        return any(one is not None for one in found) or bool(state.kept)

    @property
    def sliced(self) -> Scan | None:
        """What slices are cut through: the scan, or the voxels of grains that came without one."""
        grains = self.state.grains
        if self.state.scan is not None or grains is None:
            self._solid = None
            return self.scan
        if self._solid is None or self._solid[0] is not grains:
            self._solid = (grains, solid_as_scan(grains))
        return self._solid[1]

    @property
    def slices_voxels(self) -> bool:
        """Whether slices are cut through the voxels of grains that came without a scan."""
        return self.state.scan is None and self.state.grains is not None

    @property
    def title(self) -> str:
        """Name of the project file, or what an unsaved project is called."""
        return self.project.path.name if self.project.path else tr("Untitled project")

    # ---- changing ----------------------------------------------------------------------------

    def change(self, title: str, *, coalesce: bool = False, **changes: Any) -> None:
        """Change the project's state as one step of undo.

        Parameters
        ----------
        coalesce : bool
            Whether this belongs to the change before it if that had the same title: turning a
            spin box from 40 to 60 is one step, not twenty.
        """
        if coalesce and self._coalescing == title and self.project.history.undo_title == title:
            self.project.history.undo()
        self.project.change(title, **changes)
        self._coalescing = title if coalesce else None
        self._announce()

    def amend(self, **changes: Any) -> None:
        """Replace fields of the state as part of the last change: what follows from it, and came later."""
        self.project.amend(**changes)
        self._announce()

    def use_grains(self, regraining: Regraining, title: str) -> None:
        """Take other grains, with all that stays with them, as one step of undo."""
        state = regraining.state
        self.change(
            title,
            grains=state.grains,
            segmentation=state.segmentation,
            fits=state.fits,
            outdated=state.outdated,
        )
        if self.chosen:
            found = regraining.renumbered
            self.choose([found[label] for label in sorted(self.chosen) if label in found])

    def use_scan(self, scan: Scan, reference: ScanReference, title: str = "") -> None:
        """Begin with a scan whose reference a worker has made."""
        self._scans[reference.identity] = scan
        self.project.use_scan(scan, title=title or tr("Open scan"), reference=reference)
        self._forget_scans(reference.identity)
        self._announce()

    def give_scan(self, scan: Scan) -> None:
        """Hand over the opened scan of the present state (a project opens its scan in a worker)."""
        if self.state.scan is not None:
            self._scans[self.state.scan.identity] = scan
            self._take_scan()
            self.scan_changed.emit()
            self.state_changed.emit()

    def add_fits(self, fits: Mapping[int, FitResult], title: str, twin: KeptTwin | None = None) -> None:
        """Add or replace fits by label, and the twin that they are of, if they are of one."""
        self.project.add_fits(fits, title, twin)
        self._announce()

    def edit_grains(self, edit: Edit, title: str) -> EditOutcome[GrainSet]:
        """Correct grains by hand, as one step of undo.

        Raises
        ------
        EditError
            If the edit cannot be made.
        """
        self._coalescing = None
        outcome = self.project.edit_grains(edit, title, self.scan)
        self._announce()
        return outcome

    def take_edit(self, outcome: EditOutcome[GrainSet], begun: GrainSet, title: str) -> None:
        """Take an edit of grains that was made in a thread, as one step of undo.

        Raises
        ------
        ProjectError
            If the grains are others by now.
        """
        self._coalescing = None
        self.project.take_edit(outcome, begun, title)
        self._announce()

    def correct_voxel_size(self, size: VoxelSize) -> VoxelSizeCorrection:
        """Correct the voxel size, as one step of undo: all lengths follow.

        Raises
        ------
        ProjectError
            If there is nothing whose voxel size could be corrected, or it is this already.
        """
        self._coalescing = None
        correction = self.project.correct_voxel_size(size)
        self._announce()
        return correction

    def use_style(self, learner: StyleLearner | None, title: str = "") -> None:
        """Work with another style-learner, as one step of undo; clones of the one before go."""
        self.change(
            title or tr("Learn style"), style=learner, clones=None, surfaces=None, surface_clones=None
        )

    def use_surfaces(self, style: SurfaceStyle, title: str = "") -> None:
        """Work with a style of surfaces from now on, as one step of undo; clones of the one before go."""
        self.change(title or tr("Learn style"), style=None, clones=None, surfaces=style, surface_clones=None)

    def use_clones(self, clones: Generation | None, title: str = "") -> None:
        """Take over clones, as one step of undo."""
        self.change(title or tr("Generate clones"), clones=clones)

    def use_surface_clones(self, clones: SurfaceGeneration, title: str = "") -> None:
        """Take over clones of surfaces, as one step of undo."""
        self.change(title or tr("Generate clones"), surface_clones=clones)

    def change_fit_settings(self, **changes: Any) -> None:
        """Change what the next fit will use."""
        fit_settings: FitSettings = replace(self.state.fit_settings, **changes)
        if fit_settings != self.state.fit_settings:
            self.change(tr("Change fit settings"), coalesce=True, fit_settings=fit_settings)

    @property
    def undo_title(self) -> str | None:
        """The change that undo takes back; None where there is none."""
        history = self.project.history
        return history.undo_title if history.can_undo else None

    @property
    def redo_title(self) -> str | None:
        """The change that redo makes again; None where there is none."""
        history = self.project.history
        return history.redo_title if history.can_redo else None

    def undo(self) -> None:
        """Take the last change back."""
        self._coalescing = None
        self.project.undo()
        self._announce()

    def redo(self) -> None:
        """Make it again."""
        self._coalescing = None
        self.project.redo()
        self._announce()

    def go_to(self, position: int) -> None:
        """Undo or redo until so many of the changes in the history hold."""
        self._coalescing = None
        self.project.go_to(position)
        self._announce()

    def replace_project(self, project: Project) -> None:
        """Work on another project."""
        self.project.close()
        self.project = project
        self._scans.clear()
        self._coalescing = None
        self.selected, self.chosen = None, frozenset()
        self._announce(all_of_it=True)
        self.selection_changed.emit()
        self.project_replaced.emit()

    def hold_project(self) -> str:
        """Keep others from writing the project's file; return who works on it already, or nothing."""
        try:
            self.project.hold("the window")
        except ProjectLockedError as error:
            return str(error)
        except ProjectError as error:
            # Where nobody can write, nobody needs to be kept from it: a save will say why it fails.
            log.info("No lock: %s", str(error))
        return ""

    def begin_journal(self, project: Project) -> str:
        """Let avatars of a project be written as they are finished; from a worker.

        Returns
        -------
        str
            Why that cannot be, if it cannot.
        """
        try:
            if not project.begin_journal():
                project.begin_journal(self.spare_journal())
        except (OSError, ProjectError) as error:
            log.warning("No journal: %s", str(error))
            return str(error)
        return ""

    def give_up_work(self) -> None:
        """Remove what was finished and is not to be saved."""
        try:
            self.project.give_up_journal()
        except ProjectError as error:
            log.warning("%s", str(error))

    def merge(self, found: Project) -> Merge:
        """Bring in what the project's file holds by now, as one step of undo.

        Raises
        ------
        ProjectError
            If the two do not belong together.
        """
        self._coalescing = None
        merge = self.project.merge_with(found, tr("Merge with the file"))
        self._announce()
        return merge

    def saved(self) -> None:
        """Tell that the project was written."""
        self.state_changed.emit()

    # ---- selection ---------------------------------------------------------------------------

    def select(self, label: int | None) -> None:
        """Choose one grain by its label, or none."""
        self.choose(() if label is None else (label,))

    def choose(self, labels: Iterable[int], current: int | None = None) -> None:
        """Choose any number of grains.

        Parameters
        ----------
        labels : iterable of int
            Those that are no grain's do not count.
        current : int, optional
            Which of them is looked at; by default the one before if it is still among them, else the first.
        """
        given = [int(label) for label in labels]
        known = self._labels()
        chosen = frozenset(given) & known
        if current not in chosen:
            current = self.selected if self.selected in chosen else None
        if current is None:
            current = next((label for label in given if label in chosen), None)
        if (current, chosen) != (self.selected, self.chosen):
            self.selected, self.chosen = current, chosen
            self.selection_changed.emit()
            self.state_changed.emit()

    def toggle(self, labels: Iterable[int]) -> None:
        """Add grains to the chosen ones; if all are chosen already, take them out."""
        given = frozenset(int(label) for label in labels)
        rest = self.chosen - given if given <= self.chosen else self.chosen | given
        self.choose(sorted(rest), next(iter(sorted(given & rest)), None))

    def select_clone(self, clone: int | None) -> None:
        """Look at one clone, counted from 1, or at none."""
        if clone is not None and (self.clones is None or not 1 <= clone <= len(self.clones)):
            clone = None
        if clone != self.clone:
            self.clone = clone
            self.clone_changed.emit()

    def _labels(self) -> set[int]:
        grains = self.state.grains
        return set() if grains is None else set(grains.table["label"].tolist())

    # ---- recent files ------------------------------------------------------------------------

    @property
    def recent(self) -> list[Path]:
        """Files opened or saved last, newest first, those that still exist."""
        return files_that_exist(self.settings, "recent")

    def remember(self, path: Path) -> None:
        """Put a file at the head of the recent ones."""
        path = path.resolve()
        kept = [path, *(other for other in self.recent if other != path)][:RECENT]
        self.settings.setValue("recent", [str(entry) for entry in kept])
        self.recent_changed.emit()

    # ---- inside ------------------------------------------------------------------------------

    def _forget_scans(self, present: ScanIdentity) -> None:
        """Let go of large scans in memory that undo can read again from files of their own."""
        references = [state.scan for state in self.project.history.states if state.scan is not None]
        # The project's file holds only the scan that it was saved with.
        kept = {one.identity for one in references if one.embedded} | {present}
        for key, scan in self._scans.items():
            size = in_memory_bytes(scan.shape, np.dtype(scan.voxels.dtype))
            if scan.path is None or scan.is_memory_mapped or size <= KEPT_BYTES:
                kept.add(key)
        self._scans = {key: scan for key, scan in self._scans.items() if key in kept}
        self.project.forget_scans(kept)

    def _take_scan(self) -> None:
        reference = self.state.scan
        scan = self._scans.get(reference.identity) if reference is not None else None
        if scan is not None and reference is not None:
            scan = replace(scan, voxel_size=reference.voxel_size, origin=reference.origin)
        self.scan = scan

    def _announce(self, all_of_it: bool = False) -> None:
        """Compare the state with the one that was announced last and tell what differs."""
        before, now = self._seen, self.state
        self._seen = now
        if all_of_it or now.scan != before.scan:
            self._take_scan()
            self.scan_changed.emit()
            if self.scan is None and now.scan is not None and not all_of_it:
                self.scan_forgotten.emit()
        if all_of_it or now.grains is not before.grains:
            if not self.chosen <= self._labels():
                self.chosen &= self._labels()
                if self.selected not in self.chosen:
                    self.selected = min(self.chosen, default=None)
                self.selection_changed.emit()
            self.grains_changed.emit()
        if all_of_it or now.fits is not before.fits:
            self.fits_changed.emit()
        if all_of_it or now.style is not before.style or now.surfaces is not before.surfaces:
            self.style_changed.emit()
        if all_of_it or now.new_grains is not before.new_grains:
            before_clone, self.clone = self.clone, None
            self.clones_changed.emit()
            if before_clone is not None:
                self.clone_changed.emit()
        self._announce_rest(before, now, all_of_it)
        self.state_changed.emit()

    def _announce_rest(self, before: ProjectState, now: ProjectState, all_of_it: bool) -> None:
        if all_of_it or now.kept is not before.kept:
            self.kept_changed.emit()
        if all_of_it or now.strokes is not before.strokes or now.classifier is not before.classifier:
            self.learning_changed.emit()
        if all_of_it or now.packing is not before.packing:
            self.packing_changed.emit()
        if all_of_it or now.fit_settings != before.fit_settings or now.segmentation != before.segmentation:
            self.settings_changed.emit()
