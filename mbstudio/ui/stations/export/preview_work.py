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
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.scene.export_preview import PreviewSurfaces, preview_surfaces
from mbstudio.ui.language import tr
from mbstudio.ui.workers import Control, Task, TaskQueue

Named = tuple[str, Avatar]

LANE = "preview"
MOST_KINDS = 40
"""Avatars that the curve of a specimen is drawn with: measuring hundreds would take minutes."""
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
    curve_made : signal (SizeDistribution)
        Of the avatars themselves.
    progressed : signal (str, str)
        What is being made, and how far it is in words.
    """

    made = Signal(object, object)
    refused = Signal(str)
    specimen_made = Signal(object)
    specimen_refused = Signal(str)
    curve_made = Signal(object)
    progressed = Signal(str, str)

    def __init__(self, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
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

    def sketch(self, named: Sequence[Named], plan: SpecimenPlan) -> None:
        """Make a specimen of avatars to show its curve."""
        chosen = _spread(named)

        def work(control: Control) -> SpecimenSketch:
            specimen = specimen_of(self._measured(chosen, control), plan)
            return SpecimenSketch(plan, specimen, len(chosen), len(named))

        title = tr("Making the specimen")
        self._submit("specimen", title, work, self.specimen_made.emit, self.specimen_refused)

    def find_curve(self, named: Sequence[Named]) -> None:
        """Find the sieve curve of the avatars themselves."""
        chosen = _spread(named)

        def work(control: Control) -> SizeDistribution:
            return _own_curve(self._measured(chosen, control))

        title = tr("Making the avatars' sieve curve")
        self._submit("curve", title, work, self.curve_made.emit, self.specimen_refused)

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


def _own_curve(kinds: SpecimenKinds) -> SizeDistribution:
    """Return a target of a few points: the sizes that 0, 20, 50, 80 and 100 % of the mass is finer than."""
    order = np.argsort(kinds.sizes, kind="stable")
    sizes, mass = kinds.sizes[order], np.cumsum(kinds.volumes[order])
    middles = 100 * (mass - 0.5 * kinds.volumes[order]) / mass[-1]
    wanted = np.array([0.0, 20.0, 50.0, 80.0, 100.0])
    found = np.exp(np.interp(wanted, middles, np.log(sizes)))
    # One grain, or grains of one size, still have a curve: a steep one.
    for place in range(1, len(found)):
        found[place] = max(found[place], 1.02 * found[place - 1])
    return SizeDistribution(found, wanted, kinds.unit)
