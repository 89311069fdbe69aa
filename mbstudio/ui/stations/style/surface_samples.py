"""A few parents of a style of surfaces, and below each a clone of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QGridLayout, QLabel, QScrollArea, QVBoxLayout, QWidget

from mbstudio.scene.pictures.body_thumbnails import body_thumbnail
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label
from mbstudio.ui.widgets.grain_strip import pixmap_of

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_style import SurfaceStyle

SHOWN, SIDE = 9, 78


class SurfaceSamples(NamedTuple):
    """Pictures of parents and of a clone of each, and the parents' names."""

    names: tuple[str, ...]
    parents: tuple[np.ndarray, ...]
    clones: tuple[np.ndarray, ...]


def surface_samples(style: SurfaceStyle, colours: tuple[str, str]) -> SurfaceSamples:
    """Return pictures of some parents, spread evenly, and clones of them; any thread can make them."""
    import trimesh

    from mbstudio.core.cloning.clone_maker import make_surface
    from mbstudio.core.cloning.recipe_drawing import draw_recipes

    recipes = {recipe.parent: recipe for recipe in draw_recipes(style, len(style.parents))}
    rows = np.unique(np.linspace(0, len(style.parents) - 1, SHOWN).round().astype(int)).tolist()
    made = [trimesh.Trimesh(*make_surface(style, recipes[row]), process=False) for row in rows]
    return SurfaceSamples(
        tuple(style.parents[row].name for row in rows),
        tuple(body_thumbnail(style.parents[row].mesh(), colours[0], SIDE) for row in rows),
        tuple(body_thumbnail(mesh, colours[1], SIDE) for mesh in made),
    )


class SurfaceSampleView(QScrollArea):
    """Two rows of pictures: parents above, clones below."""

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        body = QWidget()
        body.setObjectName("panelBody")
        layout = QVBoxLayout(body)
        layout.setContentsMargins(14, 8, 14, 8)
        layout.setSpacing(6)
        self.words = label(tr("Drawing parents and clones …"), "hint", wrap=True)
        self._grid = QGridLayout()
        self._grid.setSpacing(6)
        layout.addWidget(self.words)
        layout.addLayout(self._grid)
        layout.addStretch(1)
        self.setWidget(body)
        self.names: tuple[str, ...] = ()

    def show_samples(self, samples: SurfaceSamples) -> None:
        """Show other pictures."""
        while (item := self._grid.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.deleteLater()
        self.names = samples.names
        self.words.setText(
            tr("Above: some of the parents. Below: a clone of each, in another form and a little warped.")
        )
        for row, (head, pictures) in enumerate(
            ((tr("Parents"), samples.parents), (tr("Clones"), samples.clones))
        ):
            self._grid.addWidget(label(head, "key"), row, 0)
            for column, (name, picture) in enumerate(zip(samples.names, pictures, strict=True), start=1):
                shown = tr("Clone of {parent}", parent=name) if row else name
                self._grid.addWidget(_picture(pixmap_of(picture), shown), row, column)
        self._grid.setColumnStretch(len(samples.names) + 1, 1)


def _picture(pixmap: QPixmap, name: str) -> QLabel:
    found = QLabel()
    found.setPixmap(pixmap)
    found.setFixedSize(SIDE, SIDE)
    found.setAlignment(Qt.AlignmentFlag.AlignCenter)
    found.setToolTip(name)
    found.setAccessibleName(name)
    return found
