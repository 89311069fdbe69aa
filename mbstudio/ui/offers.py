"""What the stations have for one another; none of them asks which one it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

if TYPE_CHECKING:
    from mbstudio.core.grains.suspicion.suspects import Suspect
    from mbstudio.core.populations import Population
    from mbstudio.core.populations.measuring import Known
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain


class Offers(QObject):
    """Results that one station leaves and others take.

    Attributes
    ----------
    compared : tuple of Population
        To be shown beside the project's own populations: clones and their parents.
    populations : tuple of Population
        All that were measured and can be shown.
    kept : tuple of KeptGrain
        Grains shaped by hand that can be exported, made by `learner`.
    learner : StyleLearner or None
    kept_name : str or None
        The kept grain that is chosen.
    known : dict
        Measurements of the project's bodies so far, as `measure_together` keeps them.
    suspects : dict of int to Suspect
        By label, how suspicious the grains are that were looked at.
    compared_changed, populations_changed, kept_changed, kept_chosen, suspects_changed : signal
    export_chosen : signal (str)
        Which bodies station Export is to write: 'valid', 'all', 'chosen', 'clones', 'kept' or 'kept one'.
    """

    compared_changed = Signal()
    populations_changed = Signal()
    kept_changed = Signal()
    kept_chosen = Signal()
    suspects_changed = Signal()
    export_chosen = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.compared: tuple[Population, ...] = ()
        self.populations: tuple[Population, ...] = ()
        self.kept: tuple[KeptGrain, ...] = ()
        self.learner: StyleLearner | None = None
        self.kept_name: str | None = None
        self.known: Known = {}
        self.suspects: dict[int, Suspect] = {}

    def compare(self, populations: Sequence[Population]) -> None:
        """Offer populations to be shown beside the project's own."""
        self.compared = tuple(populations)
        self.compared_changed.emit()

    def offer_populations(self, populations: Sequence[Population]) -> None:
        """Offer what was measured."""
        self.populations = tuple(populations)
        self.populations_changed.emit()

    def offer_suspects(self, suspects: Mapping[int, Suspect]) -> None:
        """Offer how suspicious grains are, by label."""
        self.suspects = dict(suspects)
        self.suspects_changed.emit()

    def offer_kept(self, kept: Sequence[KeptGrain], learner: StyleLearner | None) -> None:
        """Offer grains shaped by hand for export."""
        self.kept, self.learner = tuple(kept), learner
        self.kept_changed.emit()

    def choose_kept(self, name: str | None) -> None:
        """Choose one of the kept grains, or none."""
        if name != self.kept_name:
            self.kept_name = name
            self.kept_chosen.emit()

    def choose_export(self, kind: str) -> None:
        """Choose which bodies are exported."""
        self.export_chosen.emit(kind)
