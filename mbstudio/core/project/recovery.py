"""Taking avatars out of a journal that a program has left: what belongs to a project, and no more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mbstudio.core.counting import counted
from mbstudio.core.errors import JournalError
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.project.fit_journal import Found, find_fits, grains_digest
from mbstudio.core.project.merging import same_fit
from mbstudio.core.project.state import ProjectState


@dataclass(frozen=True)
class Recovery:
    """What a journal held for a project.

    Attributes
    ----------
    fits : mapping of int to FitResult
        Avatars that the project did not have, by label.
    seen : frozenset of bytes
        The records that were decided on: taken in, there already, or behind those of the project.
    told : str
        What a person should know, in whole sentences; empty if there is nothing to tell.
    has_file : bool
        Whether the project has a file, beside which the journal lies.
    foreign : bool
        Whether it belongs to something else, or cannot be read: then nothing was decided on.
    """

    fits: Mapping[int, FitResult]
    seen: frozenset[bytes]
    told: str = ""
    foreign: bool = False
    has_file: bool = False


def recover(journal: Path, state: ProjectState, file: str) -> Recovery | None:
    """Return what a journal holds for a project as it was read; None if there is no journal.

    Avatars of other grains are never taken. Where the project's file was written by others since the journal
    was begun, only grains that have no avatar get one.

    Parameters
    ----------
    journal : Path
    state : ProjectState
    file : str
        What tells the project's file from others; empty for work without one.
    """
    found = _recover(journal, state, file)
    return None if found is None else replace(found, has_file=bool(file))


def _recover(journal: Path, state: ProjectState, file: str) -> Recovery | None:
    try:
        found = find_fits(journal)
    except JournalError as error:
        return Recovery({}, frozenset(), str(error), foreign=True)
    if found is None:
        return None
    everything = frozenset(found.labels)
    news = {label: fit for label, fit in found.fits.items() if not same_fit(fit, state.fits.get(label))}
    damage = _damage(journal, found)
    if not news:
        return Recovery({}, everything, damage)
    if state.grains is None or found.origin.grains != grains_digest(state.grains):
        return Recovery({}, frozenset(), _of_others(journal, found), foreign=True)
    known = {int(label) for label in state.grains.table["label"]}
    if not known.issuperset(news):
        return Recovery({}, frozenset(), _of_others(journal, found), foreign=True)
    if file in found.files:
        return Recovery(news, everything, f"{_count(len(news), journal)} {damage}".strip())
    taken = {label: fit for label, fit in news.items() if label not in state.fits}
    told = (
        f"The project's file was written since {journal.name} was begun: of its "
        f"{counted(len(found.fits), 'avatar')}, {len(taken)} came in for grains without one."
    )
    return Recovery(taken, everything, f"{told} {damage}".strip())


def _count(count: int, journal: Path) -> str:
    avatars = counted(count, "avatar")
    return f"{avatars} that had not been saved came back from {journal.name}: save the project to keep them."


def _damage(journal: Path, found: Found) -> str:
    if not found.damaged:
        return ""
    places = counted(found.damaged, "place")
    return f"{journal} is damaged at {places}: grains that lack an avatar now are to be fitted again."


def _of_others(journal: Path, found: Found) -> str:
    return (
        f"{journal} holds {counted(len(found.fits), 'avatar')} of other grains than the project's, "
        "and none was taken: remove it if you do not need it."
    )
