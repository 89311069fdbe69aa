"""What of an export is looked at, and its numbers."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QFrame, QGridLayout, QHBoxLayout, QToolButton, QVBoxLayout

from mbstudio.core.dem.preview import ExportPreview
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import empty, label
from mbstudio.ui.widgets.numbers import readable_power_unit


class PreviewCard(QFrame):
    """A card with a switch, the name of the avatar with steps to its neighbours, and numbers.

    Attributes
    ----------
    switched : signal (bool)
    step_asked : signal (int)
        Towards the next avatar of the export or the one before.
    """

    switched = Signal(bool)
    step_asked = Signal(int)

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("card")
        self.switch = QCheckBox(tr("Preview"))
        self.switch.setChecked(True)
        self.switch.setToolTip(tr("Show one avatar together with its shape in the export"))
        self.name = label("", "key")
        head = QHBoxLayout()
        head.setSpacing(2)
        head.addWidget(self.switch, 1)
        head.addWidget(self.name)
        self.steps: list[QToolButton] = []
        for step, icon, tip in (
            (-1, "ph.caret-left", tr("The avatar before")),
            (1, "ph.caret-right", tr("The next avatar")),
        ):
            button = QToolButton()
            icons.set(button, icon)
            button.setIconSize(QSize(14, 14))
            button.setToolTip(tip)
            button.setAccessibleName(tip)
            button.clicked.connect(lambda _checked=False, by=step: self.step_asked.emit(by))
            head.addWidget(button)
            self.steps.append(button)
        self._rows = QGridLayout()
        self._rows.setContentsMargins(0, 0, 0, 0)
        self._rows.setHorizontalSpacing(10)
        self._rows.setVerticalSpacing(3)
        self._rows.setColumnStretch(0, 1)
        self._said = label("", "hint", wrap=True)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(12, 8, 12, 10)
        layout.setSpacing(6)
        layout.addLayout(head)
        layout.addLayout(self._rows)
        layout.addWidget(self._said)
        self.texts: dict[str, str] = {}
        self.switch.toggled.connect(self.switched)
        self.say("")

    def show_name(self, name: str, of: int) -> None:
        """Name the avatar that is looked at; steps are there where there are several."""
        self.name.setText(name)
        for button in self.steps:
            button.setVisible(of > 1)

    def say(self, words: str) -> None:
        """Show words in place of numbers, or below them; none hides them."""
        self._said.setText(words)
        self._said.setVisible(bool(words))

    def clear(self) -> None:
        """Take the numbers away."""
        empty(self._rows)
        self.texts = {}

    def show_preview(self, preview: ExportPreview) -> None:
        """Show the numbers of a preview."""
        self.clear()
        for place, (title, text, tip) in enumerate(_lines(preview)):
            key, value = label(tr(title), "key"), label(text, "value")
            value.setAlignment(Qt.AlignmentFlag.AlignRight)
            for widget in (key, value):
                widget.setToolTip(tr(tip))
            self._rows.addWidget(key, place, 0)
            self._rows.addWidget(value, place, 1)
            self.texts[title] = text
        self.say(preview.warning)


def _lines(preview: ExportPreview) -> list[tuple[str, str, str]]:
    """Return name, value and explanation of each number; the value alone is translated already."""
    figures = preview.figures
    if preview.geometry == "clump":
        return [
            (mark("Spheres"), f"{figures['spheres']:.0f}", mark("Of this clump")),
            (
                mark("IoU"),
                f"{figures['iou']:.4f}",
                mark("Volume that clump and avatar share, over the volume of their union"),
            ),
            (mark("Volume error"), _percent(figures["volume_error"]), mark("Of the union of spheres")),
            (
                mark("Inertia error"),
                _percent(figures["inertia_error"]),
                mark("Of the union of spheres; decks that state a mass carry the avatar's own inertia"),
            ),
            _hausdorff(preview),
            (
                mark("Smallest radius"),
                _length(preview, "smallest_radius_length"),
                mark("Limits the time step in most engines"),
            ),
        ]
    if preview.geometry == "mesh":
        genus = round((2 - figures["euler_number"]) / 2)
        return [
            (
                mark("Triangles"),
                tr(
                    "{triangles:.0f} ({cells:.0f} cells across)",
                    triangles=figures["triangles"],
                    cells=figures["cells"],
                ),
                mark("Of this mesh; cells: edges along the longest side"),
            ),
            (mark("Smallest angle"), f"{figures['smallest_angle']:.1f}°", mark("Engines reject slivers")),
            (
                mark("Watertight"),
                tr("yes") if figures["watertight"] else tr("no"),
                mark("Closed and oriented outwards"),
            ),
            (mark("Holes through it"), f"{genus}", mark("Genus of the surface")),
            (
                mark("Edges"),
                tr(
                    "{mean}, longest {longest}",
                    mean=_length(preview, "mean_edge_length"),
                    longest=_length(preview, "longest_edge_length"),
                ),
                mark("Mean and longest edge"),
            ),
            (mark("Volume error"), _percent(figures["volume_error"]), mark("Of the flat triangles")),
            _hausdorff(preview),
        ]
    if preview.geometry == "grid":
        return [
            (mark("Grid nodes"), f"{figures['nodes']:.0f}", mark("Of the padded grid")),
            (mark("Spacing"), _length(preview, "spacing_length"), mark("Of the nodes")),
            (mark("Volume error"), _percent(figures["volume_error"]), mark("Of the zero of the distances")),
        ]
    return [
        (mark("Control points"), f"{figures['control_points']:.0f}", mark("The avatar is exported unchanged"))
    ]


def _hausdorff(preview: ExportPreview) -> tuple[str, str, str]:
    length, share = _length(preview, "hausdorff_length"), _percent(preview.figures["hausdorff"])
    return (
        mark("Hausdorff"),
        tr("{length} ({share} of Dₙ)", length=length, share=share),
        mark("Largest distance between the two surfaces"),
    )


def _percent(share: float) -> str:
    return f"{100 * abs(share):.3f} %" if abs(share) < 0.001 else f"{100 * abs(share):.2f} %"


def _length(preview: ExportPreview, name: str) -> str:
    unit, value = preview.body.avatar.unit, preview.figures[name]
    shown = readable_power_unit(value, unit, 1)
    return f"{value * conversion_factor(unit, shown):.3g} {unit_label(shown)}"
