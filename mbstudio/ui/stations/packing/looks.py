"""What view, plots and table show of a packing at rest, prepared in the background and kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import PackingError
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.trial import Findings
from mbstudio.scene.packed_grains import (
    COLOURED_BY,
    PackedForms,
    PackedGrains,
    grain_values,
    make_forms,
    posed,
    shares_of,
)
from mbstudio.ui.language import tr
from mbstudio.ui.workers import Task, TaskQueue

TRIANGLES = {"OpenGL": 800_000, "software": 150_000}
_KEPT = 6


@dataclass(frozen=True, eq=False)
class Look:
    """A packing as it is shown.

    Attributes
    ----------
    packing : Packing
    inset : float
    findings : Findings or None
        None where it has no inner part.
    reason : str
        Why it has none.
    forms : PackedForms
    values : dict of str to float array
        By what grains are coloured, a number of each.
    """

    packing: Packing
    inset: float
    findings: Findings | None
    reason: str
    forms: PackedForms
    values: dict[str, Float[np.ndarray, " count"]]

    def surface(self, by: str) -> PackedGrains:
        """Return the grains where they lie, coloured."""
        shares, _, _ = shares_of(self.values[by])
        mould, grains = self.packing.mould, self.packing.poses
        reach = float(
            (grains.positions[:, 2] + self.packing.kinds.reaches[grains.kinds] * grains.scales).max()
        )
        return posed(self.forms, grains, mould, shares, reach)

    def ends(self, by: str) -> tuple[float, float]:
        """Return the least and the largest of the numbers by which grains are coloured."""
        _, low, high = shares_of(self.values[by])
        return low, high


class Looks(QObject):
    """Prepares looks in the lane ``view``; the newest wish wins.

    Attributes
    ----------
    ready : signal (Look)
    """

    ready = Signal(object)

    def __init__(self, queue: TaskQueue, viewport: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._queue, self._triangles = queue, TRIANGLES[viewport]
        self._kept: list[Look] = []

    def known(self, packing: Packing, inset: float) -> Look | None:
        """Return the look at a packing if it is prepared."""
        return next((one for one in self._kept if one.packing is packing and one.inset == inset), None)

    def ask(self, packing: Packing, inset: float) -> None:
        """Have a look prepared; `ready` tells when it is."""
        look = self.known(packing, inset)
        if look is not None:
            self.ready.emit(look)
            return
        triangles = self._triangles
        task = Task(tr("Measuring the packing"), lambda _control: _prepare(packing, inset, triangles))
        task.succeeded.connect(self._take)
        self._queue.submit(task, lane="view", key="packing")

    def _take(self, look: Look) -> None:
        self._kept = [look, *self._kept][:_KEPT]
        self.ready.emit(look)


def _prepare(packing: Packing, inset: float, triangles: int) -> Look:
    findings, reason = None, ""
    try:
        findings = Findings.of(packing, inset)
    except PackingError as error:
        reason = str(error)
    forms = make_forms(packing.kinds, packing.poses.kinds, triangles)
    return Look(
        packing, inset, findings, reason, forms, {by: grain_values(packing, by) for by in COLOURED_BY}
    )
