"""Keeps the latent studio in step: view, panel, pages beside the view, shelf below it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64
from PySide6.QtCore import QObject
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MbstudioError
from mbstudio.core.metrics.factor_table import LATENT_MEANINGS
from mbstudio.core.units import unit_label
from mbstudio.core.vae.shaping.latent import align_to, interpolate
from mbstudio.core.vae.shaping.latent_recipe import Operation
from mbstudio.core.vae.shaping.live_grain import AT_REST, live_grain
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from mbstudio.scene.pictures.animation import require_writer
from mbstudio.scene.pictures.morph_animation import write_morph
from mbstudio.scene.surfaces import Surface
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.language import tr
from mbstudio.ui.stations.latent.blend_page import LETTERS, STRIP
from mbstudio.ui.stations.latent.dock import LatentDock
from mbstudio.ui.stations.latent.panel import LatentPanel
from mbstudio.ui.stations.latent.pictures import LatentPictures
from mbstudio.ui.stations.latent.shelf import Shelf
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workers import Task

if TYPE_CHECKING:
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain
    from mbstudio.core.vae.shaping.live_grain import LiveGrain


_SUM = "sum of A, B and C"


class LatentLink(QObject):
    """What happens at station Latent.

    Parameters
    ----------
    station : Station
    studio : Studio
    view : SceneView
    work : LatentWork
    panel : LatentPanel
    dock : LatentDock
    shelf : Shelf
    """

    def __init__(
        self,
        station: Station,
        studio: Studio,
        view: SceneView,
        work: LatentWork,
        panel: LatentPanel,
        dock: LatentDock,
        shelf: Shelf,
    ) -> None:
        super().__init__(studio)
        self._station, self._studio, self._view, self._work = station, studio, view, work
        self._panel, self._dock, self._shelf = panel, dock, shelf
        self._scene = view.scene
        self.pictures = LatentPictures(studio.queue, studio.theme, self)
        self.letters: dict[str, tuple[str, Float64[np.ndarray, " d"]]] = {}
        self._framed: object = None
        self._deferred = DeferredCalls(self)
        self._connect()

    def _connect(self) -> None:
        work, blend, shelf = self._work, self._dock.blend, self._shelf
        work.style_taken.connect(self._take_style)
        work.meanings_changed.connect(self._show_letters)
        work.grain_changed.connect(self._show_grain)
        work.stepped.connect(blend.stop)
        work.kept_changed.connect(self._show_kept)
        shelf.kept.currentRowChanged.connect(lambda _: self._studio.offers.choose_kept(shelf.kept.chosen))
        blend.picked.connect(self.pick)
        blend.share_moved.connect(lambda share: self._interpolate(share, False))
        blend.share_settled.connect(lambda share: self._interpolate(share, True))
        blend.strength_moved.connect(lambda strength: self._add_difference(strength, False))
        blend.strength_settled.connect(lambda strength: self._add_difference(strength, True))
        blend.ghosts_changed.connect(self.show_ghosts)
        self._dock.map.walked.connect(self._walk)
        shelf.opened.connect(work.begin_with)
        self._studio.workspace.clones_changed.connect(self._show_clones)
        shelf.tabs.currentChanged.connect(lambda _: self._show_clones())
        shelf.forget_asked.connect(lambda name: work.forget([name]))
        shelf.rename_asked.connect(self._rename)
        self.pictures.ready.connect(self._picture_ready)
        self._studio.theme.changed.connect(self._repaint)

    # ---- the style-learner -----------------------------------------------------------------------

    def entered(self) -> None:
        """Learn what the latents mean when the station is entered with a style-learner."""
        self._work.learn_meanings()
        learner = self._work.learner
        if learner is not None:
            self._scene.set_unit(learner.unit)
            # The docks of the station take their room first.
            self._deferred.call(partial(self._frame, True))

    def left(self) -> None:
        """Stop playing; give the scene the unit of the grains back."""
        self._dock.blend.stop()
        self._studio.offers.choose_kept(self._shelf.kept.chosen)
        self._view.take_unit()

    def _take_style(self) -> None:
        learner, about = self._work.learner, self._work.about
        self.letters.clear()
        self.pictures.use(learner)
        for layer in (self._scene.layers.live, self._scene.layers.ghost_a, self._scene.layers.ghost_b):
            layer.set(None)
        self._dock.blend.ghosts.setChecked(False)
        self._framed = None
        for letter in LETTERS:
            self._dock.blend.set_grain(letter, "", None)
            self._dock.blend.slots[letter].set_grain(None, None)
        for place in range(len(STRIP)):
            self._dock.blend.set_step(place, None)
        self._dock.blend.set_sum(None)
        self._show_letters()
        self._show_kept()
        self._show_clones()
        if learner is not None and about is not None:
            if about.map is not None:
                self._dock.map.set_parents(about.map.places(learner.latents), about.map.share)
            names = learner.parents.names
            self.pictures.ask(dict(zip(names, learner.latents, strict=True)), "parents")
            if self._station.is_open:
                self.entered()
        self._dock.map.setEnabled(about is not None and about.map is not None)
        self._dock.factors.show_grain(None, None, False)
        self._view.arrange()
        self._studio.arrange_docks()

    # ---- the grain under the hand ----------------------------------------------------------------

    def _show_grain(self) -> None:
        work = self._work
        grain, about = work.grain, work.about
        if grain is None or about is None:
            return
        latent_station = self._station.is_open
        self._scene.layers.live.set(_surface(grain), grain.avatar.unit if latent_station else None)
        self._dock.factors.show_grain(grain, about.share_below(grain.factors), work.is_held, work.is_beyond)
        if about.map is not None:
            self._dock.map.set_here(about.map.places(grain.latent[None])[0])
        if latent_station:
            # Never under the hand: only what has come to rest moves the camera.
            self._frame(grain.cells == AT_REST)

    def _frame(self, may_move: bool) -> None:
        """Bring the grain into the picture: turned as usual the first time, else only where it is cut."""
        learner = self._work.learner
        if not self._station.is_open or learner is None or self._work.grain is None:
            return
        if self._framed is not learner:
            self._framed = learner
            self._view.arrange()
            self._scene.look_from("isometric")
        elif may_move:
            self._scene.fit_if_cut()
        self._studio.viewport.request_render()

    # ---- the shelf -------------------------------------------------------------------------------

    def _show_kept(self) -> None:
        learner, about = self._work.learner, self._work.about
        kept = self._work.kept if learner is not None else []
        parents = list(learner.parents.names) if learner is not None else []
        missing = {
            recipe.name: recipe.vector for recipe in kept if not self.pictures.has(recipe.name, recipe.vector)
        }
        there = {name: picture for name, picture in self.pictures.made.items() if name not in missing}
        self._shelf.show_grains([recipe.name for recipe in kept], parents, there, self._tips())
        self.pictures.ask(missing, "kept")
        if about is not None and about.map is not None:
            self._dock.map.set_kept(
                about.map.places(np.stack([recipe.vector for recipe in kept])) if kept else np.empty((0, 2))
            )
        self._studio.offers.offer_kept(self._work.kept_grains if learner is not None else (), learner)
        self._studio.offers.choose_kept(self._shelf.kept.chosen)

    def _show_clones(self) -> None:
        """Show the clones on the map and on the shelf; their pictures are made when they are looked at."""
        clones, about = self._work.clones, self._work.about
        if about is not None and about.map is not None:
            self._dock.map.set_clones(about.map.places(clones.latents) if clones else np.empty((0, 2)))
        names = list(clones.clones.names) if clones else []
        if self._shelf.clones.names != names:
            self._shelf.show_clones(names, self.pictures.made)
        if clones and self._shelf.strip is self._shelf.clones:
            shown = zip(names, clones.latents, strict=True)
            self.pictures.ask({n: z for n, z in shown if not self.pictures.has(n, z)}, "clones")

    def _tips(self) -> dict[str, str]:
        """Return what is told of each kept grain: its factors, and how it was made."""
        return {grain.name: describe_kept(grain) for grain in self._work.kept_grains}

    def _rename(self, name: str, to: str) -> None:
        if self._work.rename(name, to):
            self.pictures.rename(name, to.strip())
            for letter, (known, latent) in self.letters.items():
                if known == name:
                    self.letters[letter] = (to.strip(), latent)
                    self._dock.blend.set_grain(letter, to.strip(), self.pictures.made.get(to.strip()))
            self._show_kept()

    def _picture_ready(self, name: str, picture: QPixmap) -> None:
        self._shelf.set_picture(name, picture)
        for letter, (known, _) in self.letters.items():
            if known == name:
                self._dock.blend.set_grain(letter, name, picture)
        if name == _SUM:
            self._dock.blend.set_sum(picture)
        for place in range(len(STRIP)):
            if name == f"step {place}":
                self._dock.blend.set_step(place, picture)

    def _repaint(self) -> None:
        """Draw the pictures anew in the colours of the theme."""
        learner = self._work.learner
        if learner is None:
            return
        self.pictures.use(learner)
        self._show_kept()
        self.pictures.ask(dict(zip(learner.parents.names, learner.latents, strict=True)), "parents")
        self._draw_strip()

    # ---- A, B and C ------------------------------------------------------------------------------

    def pick(self, letter: str, name: str = "") -> None:
        """Let a letter stand for a grain; without a name, for the one selected on the shelf."""
        name = name or self._shelf.chosen or ""
        latent = self._work.latent_of(name)
        if latent is None:
            told = tr("Select a grain on the shelf first, then click {letter}.", letter=letter)
            self._studio.say("info", told)
            return
        self.letters[letter] = (name, latent)
        self._dock.blend.set_grain(letter, name, self.pictures.made.get(name))
        self._show_letters()
        self._draw_strip()
        self._draw_ghosts()

    def _show_letters(self) -> None:
        self._dock.blend.set_ready(set(self.letters), self._work.meanings is not None)
        about = self._work.about
        if about is not None and about.map is not None:
            plane = about.map
            self._dock.map.set_letters(
                {letter: plane.places(latent[None])[0] for letter, (_, latent) in self.letters.items()}
            )

    def _draw_strip(self) -> None:
        learner = self._work.learner
        if learner is None or not {"A", "B"} <= set(self.letters):
            return
        steps = interpolate(learner, self.letters["A"][1], self.letters["B"][1], STRIP)
        self.pictures.ask({f"step {place}": step for place, step in enumerate(steps)}, "strip")

    def _interpolate(self, share: float, final: bool) -> None:
        if not {"A", "B"} <= set(self.letters):
            return
        (a, first), (b, second) = self.letters["A"], self.letters["B"]
        given = {"a": first.tolist(), "b": second.tolist(), "share": share}
        words = tr("{percent:.0f} % from {a} to {b}", percent=100 * share, a=a, b=b)
        operation = Operation("between", given, words)
        (self._work.commit if final else self._work.preview)(operation)

    def _add_difference(self, strength: float, final: bool) -> None:
        if not set(LETTERS) <= set(self.letters):
            return
        (a, first), (b, second), (c, third) = (self.letters[letter] for letter in LETTERS)
        given = {
            "a": first.tolist(), "b": second.tolist(), "c": third.tolist(), "strength": strength,
            "told": self._dock.blend.told.isChecked(),
        }  # fmt: skip
        operation = Operation("sum", given, f"{c} + {strength:g} ({a} − {b})")
        if not final:
            self._work.preview(operation)
        elif self._work.commit(operation) and self._work.stance is not None:
            self.pictures.ask({_SUM: self._work.stance.latent}, "sum")

    def show_ghosts(self, shown: bool) -> None:
        """Show or hide A and B as ghosts about the grain."""
        for layer in ("ghost_a", "ghost_b"):
            self._view.show_layer(layer, shown)
        self._draw_ghosts()
        self._studio.commands.refresh()

    def _draw_ghosts(self) -> None:
        learner = self._work.learner
        if learner is None or not {"A", "B"} <= set(self.letters):
            self._scene.layers.ghost_a.set(None)
            self._scene.layers.ghost_b.set(None)
            return
        first = self.letters["A"][1]
        # As the interpolation takes it: mirrored to lie like A.
        second = align_to(learner, first, self.letters["B"][1])
        self._scene.layers.ghost_a.set(_surface(live_grain(learner, first, AT_REST)))
        self._scene.layers.ghost_b.set(_surface(live_grain(learner, second, AT_REST)))
        if self._station.is_open:
            self._scene.fit_if_cut()
        self._studio.viewport.request_render()

    # ---- the map ---------------------------------------------------------------------------------

    def _walk(self, place: Float64[np.ndarray, "2"], final: bool) -> None:
        x, y = (round(float(value), 4) for value in place)
        operation = Operation("place", {"place": [x, y]}, tr("map ({x:.2f}, {y:.2f})", x=x, y=y))
        (self._work.commit if final else self._work.preview)(operation)

    # ---- animation -------------------------------------------------------------------------------

    def ask_animation(self) -> None:
        """Ask for a file and write the way from A to B to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save animation"),
            str(Path.home() / "morph.gif"),
            tr("GIF (*.gif);;Numbered pictures (*.png);;MP4 (*.mp4)"),
        )
        if name:
            chosen = Path(name)
            self.save_animation(chosen if chosen.suffix else chosen.with_suffix(".gif"))

    def save_animation(self, path: Path, steps: int = 30) -> None:
        """Write the way from A to B as an animation in the background."""
        learner = self._work.learner
        if learner is None or not {"A", "B"} <= set(self.letters):
            return
        try:
            require_writer(path)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        write = partial(
            write_morph, learner, self.letters["A"][1], self.letters["B"][1], path, self._studio.theme.scene,
            steps=steps,
        )  # fmt: skip
        task = Task(tr("Writing the animation"), lambda control: write(progress=control.progress))
        if path.suffix.lower() == ".png":
            told = tr(
                "Saved the interpolation from A to B as pictures {name}_000.png, ... in {folder}.",
                name=path.stem,
                folder=path.parent,
            )
        else:
            told = tr(
                "Saved the interpolation from A to B as {name} in {folder}.",
                name=path.name,
                folder=path.parent,
            )
        task.succeeded.connect(lambda _: self._studio.say("success", told))
        self._studio.queue.submit(task)


def _surface(grain: LiveGrain) -> Surface:
    return Surface(grain.points, grain.triangles, grain.normals)


def describe_kept(grain: KeptGrain) -> str:
    """Return name and factors of a kept grain, and how it was made."""
    unit = unit_label(grain.unit)
    numbers = {
        name: f"{value:.4g} {unit}" if name == "size" else f"{value:.3f}"
        for name, value in zip(MEANINGS, grain.factors, strict=True)
    }
    factors = ", ".join(f"{tr(LATENT_MEANINGS[name].short)} {words}" for name, words in numbers.items())
    return tr(
        "{grain}: {factors}\nMade by: {operations}",
        grain=grain.name,
        factors=factors,
        operations=grain.recipe.words,
    )
