"""Making in the background what station Export shows: the shape of one avatar, and the specimen's curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.dem.body import DemBody, prepare_bodies
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.preview import ExportPreview, preview
from mbstudio.core.dem.specimen.specimen import SpecimenKinds, SpecimenPlan, specimen_of
from mbstudio.core.errors import MbstudioError
from mbstudio.core.metaball import Avatar
from mbstudio.core.populations.measuring import Known
from mbstudio.scene.export_preview import PreviewSurfaces, preview_surfaces
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.export.own_sizes import kinds_of, measure_sizes, unmeasured
from mbstudio.ui.stations.export.work import ChosenAvatars
from mbstudio.ui.workers import Control, Task, TaskQueue

Named = tuple[str, Avatar]

LANE = "preview"
MOST_KINDS = 40
"""Avatars that the curve of a scaled specimen is drawn with while not all are measured."""
_KEPT = 64


@dataclass(frozen=True, eq=False)
class SpecimenSketch:
    """A specimen as station Export shows it.

    Attributes
    ----------
    plan : SpecimenPlan
    specimen : Specimen
    kinds, of : int
        How many avatars it was made with, of how many.
    """

    plan: SpecimenPlan
    specimen: Specimen
    kinds: int
    of: int


class PreviewWork(QObject):
    """Makes previews; what is asked later takes the place of what was asked before.

    Attributes
    ----------
    made : signal (ExportPreview, PreviewSurfaces)
    refused : signal (str)
        Why an avatar cannot be exported.
    specimen_made : signal (SpecimenSketch)
    specimen_refused : signal (str)
    sizes_known : signal
        All avatars that were asked for are measured.
    measuring_changed : signal
        Avatars are being measured, or no longer.
    progressed : signal (str, str)
        What is being made, and how far it is in words.
    """

    made = Signal(object, object)
    refused = Signal(str)
    specimen_made = Signal(object)
    specimen_refused = Signal(str)
    sizes_known = Signal()
    measuring_changed = Signal()
    progressed = Signal(str, str)

    def __init__(self, queue: TaskQueue, known: Known, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._queue, self._known = queue, known
        self._measuring: Task | None = None
        self._tasks: dict[str, Task] = {}
        self._bodies: dict[Avatar, DemBody] = {}
        self._kinds: tuple[tuple[Avatar, ...], SpecimenKinds] | None = None

    def show(self, named: Named, target: str, options: Mapping[str, Any]) -> None:
        """Make the preview of one avatar."""

        def work(control: Control) -> tuple[ExportPreview, PreviewSurfaces]:
            found = preview(self._body(named), target, options, control.progress)
            return found, preview_surfaces(found)

        self._submit(
            "preview", tr("Making the preview"), work, lambda both: self.made.emit(*both), self.refused
        )

    def sketch(self, chosen: ChosenAvatars, plan: SpecimenPlan) -> None:
        """Make a specimen of avatars to show its curve: of all of them if they are measured, else of some."""
        missing = unmeasured(chosen, self._known)
        kinds = None if missing else kinds_of(chosen, self._known)
        some = _spread(chosen.named)

        def work(control: Control) -> SpecimenSketch:
            if kinds is not None:
                return SpecimenSketch(plan, specimen_of(kinds, plan), len(kinds.names), len(chosen))
            specimen = specimen_of(self._measured(some, control), plan)
            return SpecimenSketch(plan, specimen, len(some), len(chosen))

        title = tr("Making the specimen")
        self._submit("specimen", title, work, self.specimen_made.emit, self.specimen_refused)

    @property
    def is_measuring(self) -> bool:
        """Whether avatars are being measured."""
        return self._measuring is not None and not self._measuring.is_over

    def measure(self, avatars: Sequence[Avatar]) -> Task | None:
        """Measure avatars; what is done stays known if the rest is cancelled."""
        if self.is_measuring or not avatars:
            return None
        task = Task(
            plural(len(avatars), mark("Measuring {count} avatar"), mark("Measuring {count} avatars")),
            lambda control: measure_sizes(avatars, self._known, control.progress),
        )
        task.succeeded.connect(lambda _: self.sizes_known.emit())
        task.ended.connect(self.measuring_changed)
        self._measuring = task
        self._queue.submit(task)
        self.measuring_changed.emit()
        return task

    def drop(self, what: str) -> None:
        """Give up what is being made ("preview", "specimen")."""
        task = self._tasks.pop(what, None)
        if task is not None and not task.is_over:
            task.cancel()

    # ---- inside ----------------------------------------------------------------------------------

    def _submit(self, what: str, title: str, work: Any, on_done: Any, on_refused: Any) -> None:
        self.drop(what)
        task = Task(title, work)
        task.handled = (MbstudioError,)

        def succeeded(result: Any) -> None:
            if self._tasks.get(what) is task:
                on_done(result)

        def failed(error: Exception) -> None:
            if self._tasks.get(what) is task and isinstance(error, MbstudioError):
                on_refused.emit(str(error))

        task.succeeded.connect(succeeded)
        task.failed.connect(failed)
        task.reported.connect(lambda report: self.progressed.emit(what, report.message))
        self._tasks[what] = task
        self._queue.submit(task, lane=LANE, key=what)

    def _body(self, named: Named) -> DemBody:
        name, avatar = named
        known = self._bodies.get(avatar)
        if known is None:
            (known,) = prepare_bodies([avatar], [name], avatar.unit, None)
            while len(self._bodies) >= _KEPT:
                self._bodies.pop(next(iter(self._bodies)))
            self._bodies[avatar] = known
        return known

    def _measured(self, named: Sequence[Named], control: Control) -> SpecimenKinds:
        avatars = tuple(avatar for _, avatar in named)
        if self._kinds is None or self._kinds[0] != avatars:
            unit, parts = avatars[0].unit, []
            for place, (name, avatar) in enumerate(named):
                control.progress(place / len(named), tr("Measuring {name}", name=name))
                (body,) = prepare_bodies([avatar], [name], unit, None)
                parts.append(SpecimenKinds.from_bodies([body], unit))
            self._kinds = avatars, _join_kinds(parts, unit)
        return self._kinds[1]


def _join_kinds(parts: Sequence[SpecimenKinds], unit: str) -> SpecimenKinds:
    return SpecimenKinds(
        tuple(name for part in parts for name in part.names),
        np.concatenate([part.sizes for part in parts]),
        np.concatenate([part.volumes for part in parts]),
        np.concatenate([part.reaches for part in parts]),
        unit,
    )


def _spread(named: Sequence[Named]) -> list[Named]:
    """Return all avatars, or as many as are measured, evenly taken from the row."""
    if len(named) <= MOST_KINDS:
        return list(named)
    return [named[round(place)] for place in np.linspace(0, len(named) - 1, MOST_KINDS)]
