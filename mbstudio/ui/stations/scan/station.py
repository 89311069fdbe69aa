"""Station Scan: the CT stack that everything begins with."""

from __future__ import annotations

from pathlib import Path

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.scan.link import ScanLink
from mbstudio.ui.stations.scan.panel import ScanPanel
from mbstudio.ui.stations.scan.work import ScanWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.scene_view import SceneView


class ScanStation(Station):
    """Opens scans and moves their slices."""

    id, icon, guide = "scan", "ph.stack", "Scan"
    title, tip = mark("Scan"), mark("The CT stack")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = ScanWork(studio.workspace, studio.queue, self)
        self.panel: ScanPanel = ScanPanel(studio.workspace, studio.theme)
        self.display = Display(studio.workspace, ("slices", "volume"), ("slices",), shows_slices=True)
        self.link = ScanLink(studio, view, self.work, self.panel)

    def commands(self) -> list[Command]:
        return [
            Command(
                id="scan.open",
                title=tr("Open scan…"),
                run=self.link.ask_scan,
                menu="File",
                shortcut="Ctrl+O",
                icon="ph.folder-open",
                tip=tr("Open a TIFF stack, RAW, NPY, NRRD or MetaImage file"),
            ),
            Command(
                id="scan.open_folder",
                title=tr("Open folder of slices…"),
                run=self.link.ask_folder,
                menu="File",
                icon="ph.folders",
                tip=tr("Open a folder of TIFF or PNG slices"),
            ),
            Command(
                id="scan.sample",
                title=tr("Open the sample scan"),
                run=self.work.open_sample,
                menu="File",
                icon="ph.sparkle",
                tip=tr("A synthetic scan of grains in contact, made by mbstudio"),
            ),
        ]

    def wire(self) -> None:
        self.hear(self.work)
        self.studio.commands.bind(self.panel.open_button, "scan.open")
        self.studio.commands.bind(self.panel.sample_button, "scan.sample")

    def open(self, path: Path) -> bool:
        self.work.open(path)
        return True

    def project_opened(self) -> None:
        self.work.reopen()
