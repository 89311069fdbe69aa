"""The journals of one project that is worked on: one for each set of grains that avatars are made of."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from mbstudio.core.errors import JournalError, ProjectWarning
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.project.fit_journal import (
    Entry,
    FitJournal,
    Origin,
    find_fits,
    grains_digest,
    journal_path,
    remove_durably,
    set_aside,
)
from mbstudio.core.project.recovery import Recovery, recover
from mbstudio.core.project.state import ProjectState

Entered = list[tuple[FitJournal, frozenset[Entry]]]


class ProjectJournals:
    """Writes what is finished and not saved, and takes in what other programs have left.

    Attributes
    ----------
    brought_back : dict of int to FitResult
        Avatars that came out of a journal, by label.
    """

    def __init__(self) -> None:
        self.brought_back: dict[int, FitResult] = {}
        self._open: list[tuple[GrainSet, FitJournal]] = []
        self._taken: dict[Path, Recovery] = {}
        self._lock = threading.Lock()

    def take(self, place: Path, state: ProjectState, file: str) -> Mapping[int, FitResult]:
        """Return what a journal holds for a state that did not come from it before; tell what is to be known.

        Parameters
        ----------
        place : Path
        state : ProjectState
        file : str
            What tells the project's file from others; empty for work without one.
        """
        found, before = recover(place, state, file), self._taken.get(place)
        if found is None:
            return {}
        if before is not None and (found.seen, found.foreign) == (before.seen, before.foreign):
            return {}
        if found.told:
            warnings.warn(found.told, ProjectWarning, stacklevel=4)
        self._taken[place] = found
        self.brought_back |= found.fits
        return found.fits

    def begin(self, place: Path, state: ProjectState, file: str) -> None:
        """Write avatars of the grains that there are to a journal from now on; also from another thread.

        What others have written into it since it was read stays in it for the next opening.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        assert state.grains is not None
        with self._lock:
            if self.of(state.grains) is not None:
                return
            before = self._taken.pop(place, None) or Recovery({}, frozenset())
            found = recover(place, state, file)
            try:
                if found is not None and found.foreign:
                    other = set_aside(place)
                    warnings.warn(f"{place} lies in {other} now.", ProjectWarning, stacklevel=4)
                for of, journal in list(self._open):
                    if journal.path == place:
                        journal.discard()
                        self._open.remove((of, journal))
                news = found.fits if found is not None and not before.seen.issuperset(found.seen) else {}
                origin = Origin(file, grains_digest(state.grains))
                journal = FitJournal(place, origin, before.fits, news)
            except OSError as error:
                raise JournalError(f"{place} cannot be written ({error.strerror or error}).") from error
            self._open.append((state.grains, journal))

    def follow(self, state: ProjectState, saved: ProjectState | None) -> None:
        """Write what undo, redo or a change has made of avatars that had come into the project."""
        journal = self.of(state.grains)
        if journal is not None:
            in_file = saved is not None and saved.grains is state.grains
            journal.follow(state.fits, saved.fits if saved is not None and in_file else {})

    def of(self, grains: GrainSet | None) -> FitJournal | None:
        """Return the journal for these grains, if there is one."""
        return next((journal for of, journal in self._open if of is grains), None)

    def entered(self) -> Entered:
        """Return what has come into the project by now, for `settle`."""
        return [(journal, journal.entered()) for _, journal in self._open]

    def announce(self, target: Path, file: str) -> None:
        """Write what a file is about to become."""
        for _, journal in self._open:
            if journal.path == journal_path(target):
                journal.announce(file)

    def settle(self, target: Path, state: ProjectState, file: str, entered: Entered) -> None:
        """Remove what lies in a file that was saved.

        Parameters
        ----------
        target : Path
        state : ProjectState
            What was saved.
        file : str
            What tells it from others.
        entered : list
            What had come into the project before it was saved.

        Raises
        ------
        OSError
            If a journal cannot be changed.
        """
        for journal, come_in in entered:
            grains = next((of for of, one in self._open if one is journal), None)
            if grains is None:  # it was given up meanwhile
                continue
            if grains is state.grains:
                journal.settle(come_in, journal_path(target), replace(journal.origin, file=file))
            else:
                journal.discard()
                self._open.remove((grains, journal))

    def drop(self, beside: Path | None) -> None:
        """Remove journals that nobody writes if all that they hold was decided on when they were read.

        Parameters
        ----------
        beside : Path or None
            The one beside the file that was saved; those of work without a file go with it.

        Raises
        ------
        OSError
            If one cannot be removed.
        """
        written = {journal.path for _, journal in self._open}
        for place, before in list(self._taken.items()):
            if place in written or (before.has_file and place != beside):
                continue
            try:
                found = find_fits(place)
            except JournalError:  # told when it was read first: it stays for a person to look at
                continue
            if found is not None and before.seen.issuperset(found.labels):
                remove_durably(place)

    def discard(self) -> None:
        """Remove what was written: it is given up.

        Raises
        ------
        OSError
            If it cannot be removed.
        """
        while self._open:
            self._open[-1][1].discard()
            self._open.pop()

    def close(self) -> None:
        """Let go; what the journals hold stays."""
        for _, journal in self._open:
            try:
                journal.close()
            except OSError as error:
                told = f"{journal.path} could not be written to its end ({error.strerror or error})."
                warnings.warn(told, ProjectWarning, stacklevel=3)
        self._open.clear()
