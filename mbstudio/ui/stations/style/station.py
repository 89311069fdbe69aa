"""Station Style: the form of grains is learned, and new grains are generated in it."""

from __future__ import annotations

from dataclasses import replace

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.station import HalfDone, Station
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.commands import style_commands
from mbstudio.ui.stations.style.dock import StyleDock
from mbstudio.ui.stations.style.judge_work import JudgeWork
from mbstudio.ui.stations.style.link import StyleLink
from mbstudio.ui.stations.style.panel import StylePanel
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame


class StyleDisplay(Display):
    """Clones laid out in rows; the grains before there are any."""

    @property
    def shows_tray(self) -> bool:
        return True

    def layers_now(self, tray: bool) -> set[str]:
        return self.shown if tray else self.with_chosen(self.overview())


class StyleStation(Station):
    """Trains style-learners and makes clones."""

    id, icon, guide = "style", "ph.paint-brush", "New grains"
    title, tip = mark("Style"), mark("Learn the shape of grains, generate new ones")
    menu = mark("Style")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = StyleWork(studio.workspace, studio.queue, self)
        self.clone_work = CloneWork(studio.workspace, studio.queue, self)
        self.judge_work = JudgeWork(studio.workspace, studio.queue, self)
        self.panel: StylePanel = StylePanel(studio.workspace, self.work, self.clone_work)
        self.dock = StyleDock(studio.theme)
        self.display = StyleDisplay(studio.workspace, compares=True)
        self.frame = DockFrame("style", tr("Style"), self.dock, "bottom", studio.icons, height=282)
        self.docks = (self.frame,)
        self.link = StyleLink(
            studio, view, self.work, self.clone_work, self.judge_work, self.panel, self.dock
        )

    def commands(self) -> list[Command]:
        return [
            *style_commands(self.studio, self.work, self.clone_work, self.judge_work, self.panel, self.link),
            self.frame.command(
                tr("Curves and clones"),
                tr("Show or hide curves, clones and quality at station Style"),
                icon="ph.chart-line-up",
                enabled=lambda: self.is_open,
            ),
        ]

    def wire(self) -> None:
        self.relay_messages(self.work, self.clone_work, self.judge_work)
        self.work.arrived.connect(self.arrived)
        self.work.changed.connect(self.studio.refresh)
        self.clone_work.changed.connect(self.studio.refresh)
        self.judge_work.changed.connect(self.studio.refresh)
        learn, generate = self.panel.learn, self.panel.generate
        learn.readiness_changed.connect(self.studio.commands.refresh)
        for button, command in (
            (learn.learn_button, "style.learn"),
            (learn.on_button, "style.learn_on"),
            (learn.pause_button, "style.pause"),
            (learn.stop_button, "style.stop"),
            (learn.cancel_button, "style.cancel"),
            (learn.open_button, "style.open"),
            (learn.save_button, "style.save"),
            (generate.generate_button, "style.generate"),
            (generate.cancel_button, "style.cancel_clones"),
            (generate.report_button, "style.report"),
            (generate.populations_button, "style.compare"),
            (generate.export_button, "style.export"),
            (self.dock.judge.judge_button, "style.judge"),
            (self.dock.judge.cancel_button, "style.cancel_judging"),
        ):
            self.studio.commands.bind(button, command)

    def enter(self) -> None:
        self.link.lay_out()
        if self.studio.queue.running() is None:
            self.clone_work.assess()

    @property
    def half_done(self) -> HalfDone | None:
        style = self.work.arrived_style
        return None if style is None else HalfDone((style,), lambda state: replace(state, style=style))
