"""Going on with what a command that was ended has left, and leaving it so that the next one can."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console, inputs
from mbstudio.core.errors import MbstudioError

if TYPE_CHECKING:
    from mbstudio.core.imaging import FitResult
    from mbstudio.core.project import Project


def go_on_from(
    output: Path, project: Project, labels: Path | None, settings: dict[str, Any], *, named: bool
) -> Project:
    """Return the project to work on: the one given, or what the same command has left in its output.

    Parameters
    ----------
    output : Path
        The file that will be written.
    project : Project
        What was made of the input.
    labels : Path or None
        The label image that was given.
    settings : dict
        The settings for finding grains that were given.
    named : bool
        Whether the output was named by the person; then another project there is replaced.

    Raises
    ------
    MbstudioError
        If the output was not named and is there already, of something else.
    """
    from mbstudio.core.project import Project

    if not output.exists() or (project.path is not None and project.path.resolve() == output.resolve()):
        return project
    refusal = MbstudioError(f"{output} already exists: choose another file for the project with -o.")
    try:
        begun = Project.open(output)
    except MbstudioError as error:
        raise (error if named else refusal) from error
    if project.grains is not None:
        if _has_same_grains(begun, project):
            project.add_fits({label: fit for label, fit in begun.fits.items() if label not in project.fits})
            return project
    elif _is_of_same_scan(begun, project) and (labels is not None or _was_found_so(begun, settings)):
        project.close()
        return begun
    if not named:
        raise refusal
    return project


def was_found_so(project: Project, labels: Path | None, settings: dict[str, Any]) -> bool:
    """Return whether a project has its grains already as they are asked for; no setting asks for any."""
    if project.grains is None or labels is not None:
        return False
    return not settings or _was_found_so(project, settings)


def _was_found_so(project: Project, settings: dict[str, Any]) -> bool:
    from mbstudio.core.grains.segmentation import SegmentationSettings

    return project.grains is not None and project.state.segmentation == SegmentationSettings(**settings)


def _is_of_same_scan(begun: Project, project: Project) -> bool:
    one, other = begun.state.scan, project.state.scan
    if one is None or other is None:
        return False
    places = ((scan.identity, scan.voxel_size, scan.origin) for scan in (one, other))
    return len(set(places)) == 1


def _has_same_grains(begun: Project, project: Project) -> bool:
    from mbstudio.core.project.fit_journal import grains_digest

    if begun.grains is None or project.grains is None:
        return False
    return begun.grains is project.grains or grains_digest(begun.grains) == grains_digest(project.grains)


class Kept:
    """Whether results stay though the output was written, because it is not the last word."""

    stays = False


@contextmanager
def keeping_results(output: Path | None) -> Iterator[Kept]:
    """Keep what processes find beside an output until it is written, and go on from what an earlier run left.

    Parameters
    ----------
    output : Path or None
        The file or folder that will be written; the results lie in `OUTPUT.unfinished`. None keeps nothing.
    """
    from mbstudio.core.batch.kept_answers import keeping_answers

    how = Kept()
    if output is None:
        yield how
        return
    place = unfinished(output)
    with keeping_answers(place) as answers:
        if answers is not None and answers.found:
            console.tell(f"mbstudio: going on with {answers.found} results of an earlier run ({place.name}).")
        yield how
        if answers is not None:
            answers.stays = how.stays
    if answers is not None and answers.trouble is not None:
        console.tell(f"mbstudio: {place} could not be written to its end ({answers.trouble.strerror}).")


def unfinished(output: Path) -> Path:
    """Return where the results of an unfinished run lie."""
    target = output.resolve()
    return target.with_name(f"{target.name}.unfinished")


class FinishedFits:
    """Writes each avatar of a batch to the disk as soon as it is finished.

    The output holds the grains by then, and its journal the avatars. A file of avatars gives way only when
    there is one to put into its place.

    Parameters
    ----------
    project : Project
        Which holds the lock of its output.
    output : Path
    embed_scan : bool or None
        As for `Project.save`.
    """

    def __init__(self, project: Project, output: Path, embed_scan: bool | None) -> None:
        self._project, self._output, self._embed = project, output, embed_scan
        self._trouble = ""
        self._begun = False

    def begin(self) -> None:
        """Save the grains, unless the output has them or holds avatars of others."""
        path = self._project.path
        in_place = path is not None and path.resolve() == self._output.resolve()
        if in_place and self._project.begin_journal():
            self._begun = True
        elif not self._output.exists() or not self._would_lose():
            self._save()

    def keep(self, label: int, fit: FitResult) -> None:
        """Write an avatar."""
        if not self._begun:
            self._project.add_fits({label: fit})
            self._save()
            return
        trouble = self._project.keep_finished({label: fit})
        if trouble and not self._trouble:  # once, not with every grain
            console.tell(f"mbstudio: {trouble} The avatars are kept in memory until it can: make room.")
        self._trouble = trouble

    def _save(self) -> None:
        inputs.save_results(self._project, self._output, self._embed)
        self._begun = self._project.begin_journal()

    def _would_lose(self) -> bool:
        from mbstudio.core.project import Project

        there = Project.open(self._output, journal=False)
        state = there.state
        if not (state.fits or state.kept or state.style is not None):
            return False
        return bool(state.kept) or state.style is not None or not _has_same_grains(there, self._project)
