"""How grains and avatars are drawn over the flat slices, kept from one start to the next."""

from __future__ import annotations

from PySide6.QtCore import QObject, QSettings, Signal

from mbstudio.scene.label_overlay import LabelLook


class SliceLook(QObject):
    """What the person wants to see over the grey values.

    Parameters
    ----------
    settings : QSettings

    Attributes
    ----------
    changed : signal
    opacity : float
        Of the grains' fill, 0 to 1.
    outlines, chosen_only, avatar : bool
        Whether grains are outlined, only chosen ones are shown, the avatar's outline is shown.
    isolated : bool
        Whether chosen grains are shown alone in every view.
    """

    changed = Signal()

    def __init__(self, settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._settings = settings
        kept = str(settings.value("slice_fill", "0"))
        self.opacity = min(int(kept), 100) / 100 if kept.isdecimal() else 0.0
        self.outlines = settings.value("slice_outlines", "true") != "false"
        self.avatar = settings.value("slice_avatar", "true") != "false"
        # Not kept: a window that shows one grain of many at its start would be taken for a fault.
        self.chosen_only = self.isolated = False

    def label_look(self, chosen: frozenset[int]) -> LabelLook:
        """Return how labels are drawn while some grains are chosen."""
        only = chosen if (self.chosen_only or self.isolated) and chosen else None
        return LabelLook(self.opacity, self.outlines, only, chosen)

    def set_opacity(self, opacity: float) -> None:
        """Fill grains with their colours, from 0 (not at all) to 1."""
        self.opacity = opacity
        self._settings.setValue("slice_fill", str(round(100 * opacity)))
        self.changed.emit()

    def set_outlines(self, wanted: bool) -> None:
        """Outline grains, or not."""
        self.outlines = wanted
        self._settings.setValue("slice_outlines", "true" if wanted else "false")
        self.changed.emit()

    def set_chosen_only(self, wanted: bool) -> None:
        """Show no grains but the chosen ones, or all."""
        self.chosen_only = wanted
        self.changed.emit()

    def set_isolated(self, isolated: bool) -> None:
        """Follow the other views, which show chosen grains alone, or all."""
        self.isolated = isolated
        self.changed.emit()

    def set_avatar(self, wanted: bool) -> None:
        """Draw the outline of the avatar, or not."""
        self.avatar = wanted
        self._settings.setValue("slice_avatar", "true" if wanted else "false")
        self.changed.emit()
