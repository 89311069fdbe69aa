"""A project: one scan, its grains and their avatars, with undo and a file."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from psygnal import Signal

from mbstudio.core.errors import JournalError, ProjectChangedError, ProjectError, ProjectWarning
from mbstudio.core.grains.editing import Edit, EditOutcome, Replay, replay
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.project.file import read_embedded_scan, read_project, write_project
from mbstudio.core.project.fit_journal import journal_path
from mbstudio.core.project.history import History
from mbstudio.core.project.lock import ProjectLock
from mbstudio.core.project.merging import Merge, merge_states
from mbstudio.core.project.project_journals import Entered, ProjectJournals
from mbstudio.core.project.regraining import Regraining, regrain
from mbstudio.core.project.scan_reference import refer_to, reopen
from mbstudio.core.project.sealed_file import identify
from mbstudio.core.project.state import ProjectState, ScanIdentity, ScanReference
from mbstudio.core.project.voxel_size import VoxelSizeCorrection, correct_voxel_size
from mbstudio.core.scan import Scan
from mbstudio.core.scan.field_of_view import find_field_of_view
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    from mbstudio.core.grains.segmentation import SegmentationSettings
    from mbstudio.core.twin.kept_twin import KeptTwin


class Project:
    """What the window, the command line and scripts work on.

    The state is a frozen record; :meth:`change` puts a new one in its place and remembers the
    old one for :meth:`undo`. Nothing is written before :meth:`save`, also not at the end of a
    ``with`` block.

    Attributes
    ----------
    path : Path or None
        The project file; None before the first save.
    history : History
    changed : signal
        Emitted with the new :class:`ProjectState` after every change, undo and redo.

    Examples
    --------
    >>> with Project.open("sand.mbs") as project:  # doctest: +SKIP
    ...     heaviest = max(project.grains, key=lambda grain: grain.volume)
    """

    changed = Signal(ProjectState)

    def __init__(self, state: ProjectState | None = None, path: str | Path | None = None) -> None:
        self.path = Path(path) if path is not None else None
        self.history = History(state or ProjectState())
        self._saved_state: ProjectState | None = self.state
        self._opened_as: str | None = None
        self._lock: ProjectLock | None = None
        self._program = ""
        self._journals = ProjectJournals()
        self._open_scans: dict[ScanIdentity, Scan] = {}

    @classmethod
    def new(cls, scan: Scan | None = None, *, embed_scan: bool = False) -> Project:
        """Return an unsaved project, empty or of `scan`."""
        project = cls()
        if scan is not None:
            reference = refer_to(scan, embed=embed_scan)
            project._open_scans[reference.identity] = scan
            project.history = History(replace(project.state, scan=reference))
            project._saved_state = None
        return project

    @classmethod
    def open(cls, path: str | Path, *, journal: bool = True) -> Project:
        """Open a project file. The scan itself is opened when :attr:`scan` is first asked for.

        Avatars that another program had finished and not saved when it ended come in from the journal beside
        the file, as a change that is not saved yet; a warning (:class:`ProjectWarning`) says so.

        Parameters
        ----------
        path : str or Path
        journal : bool
            Whether to look for a journal.

        Raises
        ------
        ProjectError
            If the file is missing, damaged, no project, or of a newer mbstudio.
        """
        # Before it is read: what takes its place meanwhile counts as a change.
        found = identify(Path(path))
        project = cls(read_project(Path(path)), path)
        project._opened_as = found
        if journal:
            project.take_from_journal()
        return project

    @classmethod
    def recovered(
        cls,
        state: ProjectState,
        path: str | Path | None,
        scan: Scan | None = None,
        opened_as: str | None = None,
    ) -> Project:
        """Return a project of work that its file does not hold: unsaved, whatever `path` holds.

        `scan` is given where it is embedded: the file at `path` may not have its voxels. `opened_as` is what
        the work began from (see :attr:`opened_as`).
        """
        project = cls(state, path)
        project._saved_state = None
        project._opened_as = opened_as
        if scan is not None and state.scan is not None:
            project._open_scans[state.scan.identity] = scan
        return project

    @property
    def state(self) -> ProjectState:
        return self.history.state

    @property
    def opened_as(self) -> str | None:
        """What tells the file that was opened or saved last from any other at its place; None if unknown."""
        return self._opened_as

    @property
    def is_held(self) -> bool:
        """Whether this project keeps others from writing its file."""
        return self._lock is not None

    def hold(self, program: str, path: str | Path | None = None) -> None:
        """Keep others from writing the file until the project is closed; `program` is what they are told.

        Parameters
        ----------
        program : str
            Such as "the window".
        path : str or Path, optional
            The file that will be written; by default the one that the project came from.

        Raises
        ------
        ProjectLockedError
            If another program works on it.
        ProjectError
            If it cannot be written.
        """
        target = Path(path) if path is not None else self.path
        if target is None or (self._lock is not None and self._lock.covers(target)):
            return
        lock = ProjectLock.take(target, program)
        if self._lock is not None:
            self._lock.release()
        self._lock, self._program = lock, program

    @property
    def is_modified(self) -> bool:
        """Whether there is something that is not in the file."""
        return self.state is not self._saved_state

    @property
    def grains(self) -> GrainSet | None:
        return self.state.grains

    @property
    def fits(self) -> Mapping[int, FitResult]:
        """Fits by grain label."""
        return self.state.fits

    @property
    def avatars(self) -> list[Avatar]:
        """The avatar of every grain that is fitted and not excluded, by ascending label."""
        return [fit.avatar for fit in self.state.included_fits.values()]

    @property
    def scan(self) -> Scan | None:
        """The scan, opened and compared with its digest at first use; None without a scan.

        Raises
        ------
        ScanError
            If it was moved, cannot be read, or holds other voxels: see :meth:`relocate_scan`.
        """
        return self.scan_of(self.state.scan) if self.state.scan is not None else None

    def scan_of(self, reference: ScanReference) -> Scan:
        """Return the scan that a state of this project refers to, opened at first use; as :attr:`scan`."""
        if reference.identity not in self._open_scans:
            if reference.embedded and self.path is not None:
                scan = read_embedded_scan(self.path, reference)
            else:
                scan = reopen(reference)
            self._open_scans[reference.identity] = scan
        return replace(
            self._open_scans[reference.identity], voxel_size=reference.voxel_size, origin=reference.origin
        )

    def forget_scans(self, kept: Collection[ScanIdentity]) -> None:
        """Let go of opened scans but some; they are opened again when they are asked for."""
        self._open_scans = {key: scan for key, scan in self._open_scans.items() if key in kept}

    def change(self, title: str, **changes: Any) -> ProjectState:
        """Replace fields of the state, as one change that can be undone; return the new state."""
        return self._push(replace(self.state, **changes), title)

    def amend(self, **changes: Any) -> ProjectState:
        """Replace fields of the state as part of the last change: what follows from it, and came later."""
        self.history.amend(replace(self.state, **changes))
        return self._changed()

    def use_scan(
        self,
        scan: Scan,
        *,
        title: str = "Open scan",
        embed: bool = False,
        reference: ScanReference | None = None,
    ) -> ProjectState:
        """Begin with another scan: its grains and fits are yet to be found.

        Who has its `reference` already (the window makes it in a worker, as that reads all
        voxels) gives it.
        """
        reference = reference or refer_to(scan, embed=embed)
        self._open_scans[reference.identity] = scan
        # What was painted lies in the scan before; what was learned from it may serve this one.
        none = ProjectState().fits
        begun = replace(self.state, scan=reference, grains=None, fits=none, strokes=(), twin=None)
        return self._push(begun, title)

    def add_fits(
        self, fits: Mapping[int, FitResult], title: str = "Fit avatars", twin: KeptTwin | None = None
    ) -> ProjectState:
        """Add (or replace) fits by label, and the twin that they are of, if they are of one."""
        journal = self._journals.of(self.state.grains)
        if journal is not None:
            for label, fit in fits.items():
                journal.keep(label, fit)
        state = self.state.with_fits(fits)
        state = self._push(state if twin is None else replace(state, twin=twin), title)
        if journal is not None:
            journal.enter(fits)
        return state

    # ---- the journal ---------------------------------------------------------------------------

    @property
    def brought_back(self) -> Mapping[int, FitResult]:
        """Avatars that came in from a journal, by label."""
        return self._journals.brought_back

    def take_from_journal(self, place: Path | None = None) -> None:
        """Bring in avatars that were finished and not saved; a warning (:class:`ProjectWarning`) says so.

        Parameters
        ----------
        place : Path, optional
            The journal of work that has no file; by default the one beside the file.
        """
        if place is None:
            if self.path is None:
                return
            found = self._journals.take(journal_path(self.path), self.state, self._opened_as or "")
        else:
            found = self._journals.take(place, self.state, "")
        if found:
            self._push(self.state.with_fits(found), "Bring back avatars")

    def begin_journal(self, place: Path | None = None) -> bool:
        """Write avatars to a journal from now on, as they are finished, until the project is saved.

        The journal lies beside the project's file, if this project holds it (:meth:`hold`) and the file has
        the grains that there are now. May be called from another thread.

        Parameters
        ----------
        place : Path, optional
            Where it lies otherwise.

        Returns
        -------
        bool
            Whether there is a journal now.

        Raises
        ------
        ProjectError
            If it cannot be written.
        """
        state = self.state
        if state.grains is None or self._journals.of(state.grains) is not None:
            return state.grains is not None
        if self._has_file_with(state.grains):
            assert self.path is not None
            self._journals.begin(journal_path(self.path), state, self._opened_as or "")
        elif place is not None:
            self._journals.begin(place, state, "")
        return self._journals.of(state.grains) is not None

    def keep_finished(self, fits: Mapping[int, FitResult], grains: GrainSet | None = None) -> str:
        """Write avatars to the journal before :meth:`add_fits` brings them in; also from another thread.

        Parameters
        ----------
        fits : mapping of int to FitResult
        grains : GrainSet, optional
            What they were fitted to; by default the grains that there are now.

        Returns
        -------
        str
            What keeps them from the disk, if something does; they are tried again with the next.
        """
        journal = self._journals.of(self.state.grains if grains is None else grains)
        if journal is None:
            return ""
        for label, fit in fits.items():
            journal.keep(label, fit)
        trouble = journal.trouble
        return "" if trouble is None else f"{journal.path} cannot be written ({trouble.strerror or trouble})."

    def give_up_journal(self) -> None:
        """Remove what was finished and not saved, for it is not wanted.

        Raises
        ------
        ProjectError
            If it cannot be removed.
        """
        try:
            self._journals.discard()
            held = self.path is not None and self._lock is not None and self._lock.covers(self.path)
            self._journals.drop(journal_path(self.path) if self.path is not None and held else None)
        except OSError as error:
            raise JournalError(f"The journal of {self.path} cannot be removed ({error}).") from error

    def _has_file_with(self, grains: GrainSet) -> bool:
        """Return whether this project holds a file, which has these grains."""
        saved = self._saved_state
        return (
            self.path is not None
            and self._lock is not None
            and self._lock.covers(self.path)
            and saved is not None
            and saved.grains is grains
            and identify(self.path) == self._opened_as
        )

    def _settle_journals(self, target: Path, state: ProjectState, entered: Entered) -> None:
        """Remove from the journals what lies in the file that was saved."""
        try:
            self._journals.settle(target, state, self._opened_as or "", entered)
            self._journals.drop(journal_path(target) if self._is_own(target) else None)
        except OSError as error:
            warnings.warn(
                f"{target} was saved, but its journal could not be removed ({error.strerror or error}).",
                ProjectWarning,
                stacklevel=4,
            )

    def edit_grains(self, edit: Edit, title: str = "", scan: Scan | None = None) -> EditOutcome[GrainSet]:
        """Correct grains by hand, as one change.

        Avatars and measures of grains that the edit leaves as they are stay; see
        :meth:`ProjectState.with_edit`.

        Parameters
        ----------
        edit : Edit
            Such as ``Merge(labels=(3, 7))``.
        title : str, optional
            The title of the change; what the edit does by default.
        scan : Scan, optional
            The project's scan, where it is open already.

        Raises
        ------
        ProjectError
            If there are no grains.
        EditError
            If the edit cannot be made.
        ScanError
            If it looks at grey values and the scan cannot be opened.
        """
        grains = self.grains_to_edit(scan)
        if edit.needs_scan and scan is None:
            scan = self.scan
        outcome = grains.edit(edit, scan if edit.needs_scan else None)
        self._push(self.state.with_edit(outcome), title or edit.described())
        return outcome

    def take_edit(self, outcome: EditOutcome[GrainSet], begun: GrainSet, title: str = "") -> None:
        """Take an edit that was made elsewhere, such as in a thread, as one change.

        Parameters
        ----------
        outcome : EditOutcome
        begun : GrainSet
            What it was made of: what :meth:`grains_to_edit` gave.
        title : str, optional

        Raises
        ------
        ProjectError
            If the project's grains are others by now.
        """
        grains = self.state.grains
        if grains is None or grains.label_volume is not begun.label_volume or grains.edits != begun.edits:
            raise ProjectError("The grains have changed meanwhile: make the correction again.")
        self._push(self.state.with_edit(outcome), title or outcome.edit.described())

    def correct_voxel_size(self, size: VoxelSize | str) -> VoxelSizeCorrection:
        """Correct the voxel size, as one change: all lengths of the project follow.

        Parameters
        ----------
        size : VoxelSize or str
            ``"14 um"``, ``"20 x 14 x 14 um"`` (z, y, x).

        Returns
        -------
        VoxelSizeCorrection
            What was done, with notes on what cannot follow.

        Raises
        ------
        ProjectError
            If there is nothing whose voxel size could be corrected, or it is this already.
        UnitError
            If the size is none.
        """
        correction = correct_voxel_size(self.state, VoxelSize.parse(size))
        self._push(correction.state, correction.title)
        return correction

    def replay_edits(self, edits: Sequence[Edit], title: str = "Replay edits") -> Replay[GrainSet]:
        """Make edits again that were made on other grains of the same scan, as one change.

        Raises
        ------
        ProjectError, ScanError
            As :meth:`edit_grains`.
        """
        scan = self.scan if any(edit.needs_scan for edit in edits) else None
        replayed = replay(edits, self.grains_to_edit(), scan)
        if replayed.made:
            state = self.state
            for outcome in replayed.made:
                state = state.with_edit(outcome)
            self._push(state, title)
        return replayed

    def use_grains(
        self, grains: GrainSet, settings: SegmentationSettings | None, title: str = "Find grains"
    ) -> Regraining:
        """Take other grains of the same scan, as one change; see :func:`regrain` for what stays.

        Raises
        ------
        ProjectError, ScanError
            As :meth:`edit_grains`.
        """
        before = self.state.grains
        looks = before is not None and any(edit.needs_scan for edit in before.edits)
        regraining = regrain(self.state, grains, settings, self.scan if looks else None)
        self._push(regraining.state, title)
        return regraining

    def grains_to_edit(self, scan: Scan | None = None) -> GrainSet:
        """Return the grains with the field of view, beyond which nothing may be painted.

        Parameters
        ----------
        scan : Scan, optional
            The project's scan, where it is open already.

        Raises
        ------
        ProjectError
            If there are no grains.
        ScanError
            If the field of view is to be found and the scan cannot be opened.
        """
        grains = self.state.grains
        if grains is None:
            raise ProjectError(
                "The project has no grains to correct: find them with 'mbstudio segment' first."
            )
        if grains.view is not None or grains.is_of_meshes or self.state.scan is None:
            return grains
        scan = scan if scan is not None else self.scan
        if scan is None or scan.shape != grains.label_volume.shape:
            return grains
        # Projects of older versions do not hold it; nothing may be painted beyond it.
        return replace(grains, view=find_field_of_view(scan.voxels))

    def relocate_scan(self, path: str | Path) -> Scan:
        """Tell where the scan lies now; it must hold the same voxels.

        Raises
        ------
        ProjectError
            If the project has no scan.
        ScanError
            If `path` cannot be read or holds other voxels.
        """
        if self.state.scan is None:
            raise ProjectError("The project has no scan that could have moved: open one first.")
        scan = reopen(self.state.scan, Path(path))
        self._open_scans[self.state.scan.identity] = scan
        self.change("Relocate scan", scan=replace(self.state.scan, path=Path(path)))
        return scan

    def undo(self) -> ProjectState:
        """Take the last change back; ProjectError if there is none."""
        self.history.undo()
        return self._changed()

    def redo(self) -> ProjectState:
        """Make the change that was taken back last again; ProjectError if there is none."""
        self.history.redo()
        return self._changed()

    def go_to(self, position: int) -> ProjectState:
        """Undo or redo until so many of the changes hold; ProjectError if there are not so many."""
        self.history.go_to(position)
        return self._changed()

    def merge_with_file(self, title: str = "Merge with the file") -> Merge:
        """Bring in what another program has written into the file since it was opened, as one change.

        The next save then replaces the file.

        Raises
        ------
        ProjectError
            If there is no file, it cannot be read, or they do not belong together.
        """
        if self.path is None:
            raise ProjectError("The project has no file yet that it could be merged with.")
        return self.merge_with(Project.open(self.path, journal=False), title)

    def merge_with(self, found: Project, title: str = "Merge with the file") -> Merge:
        """Bring in what the project's file holds by now, as opened by somebody else, as one change.

        Raises
        ------
        ProjectError
            If the two do not belong together.
        """
        merge = merge_states(self._saved_state, self.state, found.state)
        self._push(merge.state, title)
        self._opened_as = found.opened_as
        return merge

    def save(self, path: str | Path | None = None, *, embed_scan: bool | None = None) -> Path:
        """Write the project to `path`, or to the file that it came from.

        Parameters
        ----------
        path : str or Path, optional
        embed_scan : bool, optional
            Whether the file holds the scan's voxels too; by default as before. A scan that
            lies in no file of its own is always embedded.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        ProjectChangedError
            If the file is no longer what was opened: see :meth:`merge_with_file`.
        ProjectLockedError
            If another program works on the file.
        ProjectError
            If there is no path yet, or the file cannot be written; an older file stays as it was.
        ScanError
            If the scan is to be embedded and cannot be opened.
        """
        target = Path(path) if path is not None else self.path
        if target is None:
            raise ProjectError("The project has no file yet: give a path to save, for example 'sand.mbs'.")
        # Before the state is: what comes in between stays in the journal, which does no harm.
        entered = self._journals.entered()
        begun = state = self.state
        if state.scan is not None and embed_scan is not None:
            embedded = embed_scan or state.scan.path is None
            if embedded != state.scan.embedded:
                state = replace(state, scan=replace(state.scan, embedded=embedded))
                state = state.logging("Embed scan" if embedded else "Do not embed scan", begun)
        scan = self.scan if state.scan is not None and state.scan.embedded else None
        with self._alone(target):
            self._require_unchanged(target)
            self._write(target, state, scan)
            self._opened_as = identify(target)
            self._settle_journals(target, state, entered)
        self.path = target
        # What was written, not what holds now: the window saves in a worker, and work goes on.
        self._saved_state = state
        if state is not begun:
            title = state.log[-1]
            if self.state is begun:
                self.history.push(state, title)
                self._changed()
            else:
                self._push(replace(self.state, scan=state.scan), title)
        return target

    def _write(self, target: Path, state: ProjectState, scan: Scan | None) -> None:
        """Write a state; whatever ends this, the journal belongs to the file before and to the new one."""
        announced: list[str] = []

        def announce(file: str) -> None:
            announced.append(file)
            self._journals.announce(target, file)

        try:
            write_project(target, state, scan.voxels if scan is not None else None, announce)
        except ProjectError:
            # It can be in its place though it was not flushed to the disk: then it is what we work on.
            if self._is_own(target) and identify(target) in announced:
                self._opened_as = identify(target)
            raise

    def _is_own(self, target: Path) -> bool:
        return self.path is not None and target.resolve() == self.path.resolve()

    @contextmanager
    def _alone(self, target: Path) -> Iterator[None]:
        """Write a file while nobody else does; a project that holds its file holds the new one then."""
        if self._lock is not None and self._lock.covers(target):
            yield
            return
        lock = ProjectLock.take(target, self._program or "a save")
        try:
            yield
        except BaseException:
            lock.release()
            raise
        if self._lock is None:
            lock.release()
        else:
            self._lock.release()
            self._lock = lock

    def _require_unchanged(self, target: Path) -> None:
        if (
            self._is_own(target)
            and self._opened_as is not None
            and identify(target) not in (None, self._opened_as)
        ):
            raise ProjectChangedError(
                f"{target} was written by another program since it was opened here, and was not replaced: "
                "save under another name, merge the two, or open it anew."
            )

    def close(self) -> None:
        """Let go of the scan's file and of the project's own; unsaved changes stay in memory only.

        What a journal holds stays for the next opening.
        """
        self._open_scans.clear()
        self._journals.close()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def __enter__(self) -> Project:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _push(self, state: ProjectState, title: str) -> ProjectState:
        self.history.push(state.logging(title, self.state), title)
        return self._changed()

    def _changed(self) -> ProjectState:
        """Let the journal and all others know of another state."""
        self._journals.follow(self.state, self._saved_state)
        self.changed.emit(self.state)
        return self.state
