"""Keeps the gallery in step with grains, avatars, clones and the one selection, and draws its pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from PySide6.QtCore import QObject, QPoint

from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.core.populations import Population
from mbstudio.scene.pictures.body_thumbnails import body_thumbnail
from mbstudio.scene.pictures.grain_thumbnails import grain_thumbnail
from mbstudio.scene.pictures.thumbnails import thumbnail
from mbstudio.ui.language import tr
from mbstudio.ui.stations.gallery.body_list import SIDE, Bodies
from mbstudio.ui.stations.gallery.gallery import KINDS, Gallery
from mbstudio.ui.studio import Studio
from mbstudio.ui.widgets.dock_frame import DockFrame
from mbstudio.ui.widgets.grain_strip import pixmap_of
from mbstudio.ui.workers import Control, Report, Task

LANE = "gallery"
_FACTORS = ("dn", "volume", "area", "sphericity", "circularity", "csf", "elongation", "flatness", "convexity")


class GalleryLink(QObject):
    """What happens in the gallery.

    Parameters
    ----------
    studio : Studio

    Attributes
    ----------
    gallery : Gallery
    frame : DockFrame
        That it stands in.
    """

    def __init__(self, studio: Studio) -> None:
        super().__init__(studio)
        self._studio, self._space = studio, studio.workspace
        self.gallery = Gallery(studio.icons)
        self.frame = DockFrame("bodies", tr("Gallery"), self.gallery, "right", studio.icons)
        self._made: dict[str, tuple[tuple[object, ...], Bodies | None]] = {}
        self._is_telling = False
        self._suspects: Mapping[int, Suspect] = {}
        studio.offers.suspects_changed.connect(self._take_suspects)
        space = self._space
        for signal in (
            space.grains_changed, space.fits_changed, space.clones_changed,
            studio.offers.populations_changed,
        ):  # fmt: skip
            signal.connect(self.show)
        self.frame.visibilityChanged.connect(lambda _: self.show())
        self.gallery.kind_changed.connect(lambda _: self.show())
        self.gallery.measure_asked.connect(lambda: studio.commands.run("populations.measure"))
        self.gallery.list.chosen.connect(self._chosen)
        self.gallery.list.menu_asked.connect(self._open_menu)
        self.gallery.list.pictures_wanted.connect(self._draw)
        space.selection_changed.connect(self._mark)
        space.clone_changed.connect(self._mark)
        studio.theme.changed.connect(self._repaint)

    def show(self) -> None:
        """Bring the gallery up to date, if it is to be seen."""
        if self.frame.isHidden():
            return
        state = self._space.state
        counts = (state.grains, state.fits, state.new_grains)
        self.gallery.set_counts(
            {kind: 0 if given is None else len(given) for kind, given in zip(KINDS, counts, strict=True)}
        )
        bodies = self._bodies(self.gallery.kind)
        if bodies is not self.gallery.bodies or bodies is None:
            self.gallery.show_bodies(bodies)
        self._mark()

    def _take_suspects(self) -> None:
        """Take scores at the beginning and at the end of looking: pictures are laid out anew for them."""
        suspects = self._studio.offers.suspects
        if self._studio.queue.running("looking") is None or not suspects:
            self._suspects = suspects
            self.show()

    # ---- what is shown -------------------------------------------------------------------------

    def _bodies(self, kind: str) -> Bodies | None:
        """Return the bodies of a kind; the same object as long as nothing about them changed."""
        state = self._space.state
        measured = self._measured(kind)
        source: tuple[object, ...] = {
            "grains": (state.grains, measured, self._suspects),
            "avatars": (state.fits, measured),
            "clones": (state.new_grains, measured),
        }[kind]
        known = self._made.get(kind)
        if known is None or any(a is not b for a, b in zip(known[0], source, strict=True)):
            make: Callable[[Population | None], Bodies | None] = getattr(self, f"_{kind}")
            made = make(measured)
            if known is not None and known[1] is not None and made is not None and known[0][0] is source[0]:
                made.pictures.update(known[1].pictures)  # only more is known of the same bodies
            self._made[kind] = (source, made)
        return self._made[kind][1]

    def _measured(self, kind: str) -> Population | None:
        if kind == "clones":
            clones = self._space.clones
            return None if clones is None else clones.factors
        return next((given for given in self._studio.offers.populations if given.kind == kind), None)

    def _grains(self, measured: Population | None) -> Bodies | None:
        grains = self._space.state.grains
        if grains is None:
            return None
        keys, volume = grains.table["label"].to_numpy(int), grains.table["volume"].to_numpy(float)
        known = {"dn": nominal_diameters(volume), "volume": volume}
        if self._suspects:
            scores = [self._suspects[key].score if key in self._suspects else np.nan for key in keys.tolist()]
            known["suspicion"] = np.array(scores)
        colour = self._studio.theme.scene.grain
        return Bodies(
            "grains", keys, known | _columns(keys, measured, grains.unit), grains.unit,
            lambda row: grain_thumbnail(grains[row], colour, SIDE),
        )  # fmt: skip

    def _avatars(self, measured: Population | None) -> Bodies | None:
        fits = self._space.state.fits
        if not fits:
            return None
        keys = np.array(sorted(fits), dtype=int)
        unit, colour = fits[int(keys[0])].avatar.unit, self._studio.theme.scene.avatar
        return Bodies(
            "avatars", keys, _columns(keys, measured, unit), unit,
            lambda row: thumbnail(fits[int(keys[row])].avatar, colour, SIDE),
        )  # fmt: skip

    def _clones(self, measured: Population | None) -> Bodies | None:
        clones = self._space.clones
        if clones is None:
            return None
        keys = np.arange(1, len(clones) + 1)
        unit, colour = clones.unit, self._studio.theme.scene.avatar
        # Clones are measured in their order.
        columns = {} if measured is None else _columns(measured.labels, measured, unit)
        return Bodies(
            "clones", keys, columns, unit, lambda row: body_thumbnail(clones.body(row), colour, SIDE)
        )

    # ---- selection -----------------------------------------------------------------------------

    def _chosen(self, keys: list[int], current: int | None) -> None:
        self._is_telling = True
        try:
            if self.gallery.kind == "clones":
                self._space.select_clone(current if current in keys else None)
            else:
                self._space.choose(keys, current)
        finally:
            self._is_telling = False

    def _mark(self) -> None:
        if self.frame.isHidden() or self._is_telling:
            return
        if self.gallery.kind == "clones":
            one = self._space.clone
            self.gallery.list.select_keys(() if one is None else (one,), one)
        else:
            self.gallery.list.select_keys(self._space.chosen, self._space.selected)

    def _open_menu(self, key: int | None, place: QPoint) -> None:
        """Offer what can be done with grains and avatars; clones are no grains of the scan."""
        if self.gallery.kind != "clones":
            self._studio.grain_menu.open(key, place)

    # ---- pictures ------------------------------------------------------------------------------

    def _draw(self, bodies: Bodies, rows: list[int]) -> None:
        """Draw what is looked at; what was asked for before and is not begun gives way to it."""

        def pictures(control: Control) -> Iterator[tuple[int, np.ndarray]]:
            for row in rows:
                yield row, bodies.draw(row)

        task = Task(tr("Drawing the gallery"), pictures)
        task.reported.connect(lambda report: self._show_picture(bodies, report))
        running = self._studio.queue.running(LANE)
        if running is not None:
            running.cancel()
        self._studio.queue.submit(task, lane=LANE, key=LANE)

    def _show_picture(self, bodies: Bodies, report: Report) -> None:
        for row, picture in report.steps:
            self.gallery.list.set_picture(bodies, row, pixmap_of(picture))

    def _repaint(self) -> None:
        """Draw the pictures anew in the colours of the theme."""
        self._made.clear()
        self.show()


def _columns(keys: np.ndarray, measured: Population | None, unit: str) -> dict[str, Any]:
    """Return the key factors of bodies by their labels; NaN for those that were not measured."""
    if measured is None:
        return {}
    given = measured.in_unit(unit)
    places = {int(label): row for row, label in enumerate(given.labels)}
    rows = np.array([places.get(int(key), -1) for key in keys], dtype=int)
    if not (rows >= 0).any():
        return {}
    return {
        name: np.where(rows >= 0, given.factors[name][rows], np.nan)
        for name in _FACTORS
        if name in given.factors
    }
