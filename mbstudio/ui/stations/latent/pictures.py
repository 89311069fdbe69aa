"""Small pictures of grains for the shelf and the strips, made in the background and remembered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QPixmap

from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.scene.pictures.thumbnails import thumbnail
from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.grain_strip import SIDE, pixmap_of
from mbstudio.ui.workers import Control, Report, Task, TaskQueue

LANES = ("pictures", "pictures of parents")
"""Of what was just made, and of parents and clones: hundreds of them must not keep the others waiting."""


class LatentPictures(QObject):
    """Pictures by name; those with a key replace the ones of the same key that are not made yet.

    Attributes
    ----------
    ready : signal (str, QPixmap)
    """

    ready = Signal(str, object)

    def __init__(self, queue: TaskQueue, theme: Theme, parent: QObject) -> None:
        super().__init__(parent)
        self._queue, self._theme = queue, theme
        self.made: dict[str, QPixmap] = {}
        self._of: dict[str, bytes] = {}
        self._learner: StyleLearner | None = None

    def use(self, learner: StyleLearner | None) -> None:
        """Forget the pictures of another style-learner's grains."""
        self._learner = learner
        for lane in LANES:
            self._queue.cancel_all(lane)
        self.made.clear()
        self._of.clear()

    def has(self, name: str, latent: Float[np.ndarray, " d"]) -> bool:
        """Return whether there is a picture of this name, and of this grain: names are given anew."""
        return name in self.made and self._of[name] == np.asarray(latent, dtype=float).tobytes()

    def rename(self, name: str, to: str) -> None:
        """Let a picture stand for its grain under another name."""
        if name in self.made:
            self.made[to], self._of[to] = self.made.pop(name), self._of.pop(name)

    def ask(self, latents: Mapping[str, Float[np.ndarray, " d"]], key: str) -> None:
        """Make the pictures of these grains; `ready` tells of each."""
        learner, colour = self._learner, self._theme.scene.avatar
        if learner is None or not latents:
            return
        names, vectors = list(latents), np.stack(list(latents.values()))

        def drawn(control: Control) -> Iterator[tuple[str, np.ndarray, Any]]:
            for name, vector in zip(names, vectors, strict=True):
                yield name, vector, thumbnail(learner.decode(vector[None]).avatar(0), colour, SIDE)

        task = Task(tr("Drawing small pictures"), drawn)
        task.reported.connect(lambda report: self._deliver_picture(learner, report))
        self._queue.submit(task, lane=LANES[key in ("parents", "clones")], key=key)

    def _deliver_picture(self, learner: StyleLearner, report: Report) -> None:
        if learner is not self._learner:
            return
        for name, vector, picture in report.steps:
            pixmap = pixmap_of(picture)
            self.made[name], self._of[name] = pixmap, vector.tobytes()
            self.ready.emit(name, pixmap)
