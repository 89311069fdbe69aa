"""Pictures of every station: none empty, no words cut off; ``--images FOLDER`` keeps them.

``python3 run.py test tests/ui/test_images.py --full --images docs/img`` makes those of the documents anew.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import QAbstractButton, QLabel, QPushButton

from mbstudio.core.grains import load_labels
from mbstudio.core.imaging import fit
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.scan_reference import refer_to
from mbstudio.core.scan import sample_scan
from mbstudio.core.vae.generate.generator import generate
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serializer import serialize

SIZES = {"": QSize(1280, 800), "-large": QSize(2560, 1440)}
FITTED = 10


@pytest.fixture(scope="module")
def sample_state():
    """The sample with its true grains, avatars of the first ones, a style of these, and clones."""
    sample = sample_scan()
    grains = load_labels(sample.labels, voxel_size=str(sample.scan.voxel_size))
    labels = grains.interior_labels[:FITTED]
    fits = {label: fit(grains.grain(label), 40, seed=0) for label in labels}
    learner = learn(serialize([grains.grain(label) for label in labels], n=40), "pca", seed=0)
    clones = generate(learner, 40, seed=1)
    state = ProjectState(scan=refer_to(sample.scan), grains=grains, fits=fits, style=learner, clones=clones)
    return state, sample.scan


def cut_off(window):
    """Return the words of visible labels and buttons that have less room than they need."""
    found = []
    for widget in [*window.findChildren(QLabel), *window.findChildren(QPushButton)]:
        if not widget.isVisible() or not widget.text() or not widget.visibleRegion().boundingRect().isValid():
            continue
        if isinstance(widget, QLabel) and (
            widget.wordWrap() or widget.textFormat() == Qt.TextFormat.RichText or "<" in widget.text()
        ):
            continue
        wanted = widget.fontMetrics().size(0, widget.text().replace("&", "")).width()
        inner = widget.contentsRect().width() if isinstance(widget, QAbstractButton) else widget.width()
        if wanted > inner + 1:
            found.append(widget.text())
    return found


@pytest.mark.full
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("theme_name", ["light", "dark"])
def test_every_station(window, idle, qtbot, request, tmp_path, sample_state, theme_name, size):
    state, scan = sample_state
    given = request.config.getoption("--images")
    folder = Path(given) if given else tmp_path
    folder.mkdir(parents=True, exist_ok=True)
    window.theme.choose(theme_name)
    window.resize(SIZES[size])
    seen = {}

    def keep(name):
        for _ in range(3):
            idle()
            qtbot.wait(150)
        assert cut_off(window) == [], name
        picture = window.grab().toImage()
        path = folder / f"{name}-{theme_name}{size}.png"
        picture.save(str(path))
        # 256 colours are a quarter of the bytes, and look the same.
        with Image.open(path) as shot:
            shot.convert("RGB").quantize(256).save(path, optimize=True)
        seen[name] = picture

    keep("welcome")
    project = Project.recovered(state, None, scan)
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    idle()
    for station in [station.id for station in window.stations]:
        window.enter(station)
        if station in ("fit", "populations"):
            window.workspace.select(sorted(state.fits)[2])
        if station == "populations":
            window.commands.run("populations.measure")
        if station == "grains":
            window.shell.show_gallery(True)
        keep(station)
        window.shell.show_gallery(False)
        window.messages.dismiss()
    # Each is a picture of its own, and of its theme.
    assert len({picture.constBits().tobytes() for picture in seen.values()}) == len(seen)
    for name, picture in seen.items():
        rail = np.mean([picture.pixelColor(20, y).lightness() for y in range(500, 700, 10)])
        assert (rail > 180) == (theme_name == "light"), name
