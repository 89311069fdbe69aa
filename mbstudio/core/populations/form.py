"""Form of the bodies of a population: the classes of Zingg and of Sneed and Folk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.populations.population import Population

ZINGG_LIMIT = 2.0 / 3.0
ZINGG_CLASSES = ("disc", "equant", "blade", "rod")
"""Oblate, equant, bladed and prolate bodies by Zingg's names."""

SNEED_FOLK_CLASSES = (
    "compact",
    "compact-platy", "compact-bladed", "compact-elongate",
    "platy", "bladed", "elongate",
    "very platy", "very bladed", "very elongate",
)  # fmt: skip
SNEED_FOLK_HEIGHTS = (0.3, 0.5, 0.7)
SNEED_FOLK_SIDES = (1.0 / 3.0, 2.0 / 3.0)


@dataclass(frozen=True, eq=False)
class FormDiagram:
    """Where the bodies of a population lie in a diagram of form, and in which class.

    Attributes
    ----------
    labels : int array, shape (bodies,)
        Of the bodies that have axes.
    x, y : float array, shape (bodies,)
        Zingg: c/b = L_s / L_i and b/a = L_i / L_l. Sneed and Folk: (a - b) / (a - c) and c/a = L_s / L_l.
    classes : tuple of str, length bodies
    names : tuple of str
        All classes of the diagram.
    volumes : float array, shape (bodies,)
        In unit**3.
    """

    labels: Int[np.ndarray, " bodies"]
    x: Float[np.ndarray, " bodies"]
    y: Float[np.ndarray, " bodies"]
    classes: tuple[str, ...]
    names: tuple[str, ...]
    volumes: Float[np.ndarray, " bodies"]

    @property
    def counts(self) -> dict[str, int]:
        """Number of bodies in every class."""
        return {name: self.classes.count(name) for name in self.names}

    @property
    def volume_shares(self) -> dict[str, float]:
        """Share of the volume in every class, of sum 1."""
        classes = np.array(self.classes, dtype=object)
        total = float(self.volumes.sum())
        return {name: float(self.volumes[classes == name].sum()) / total for name in self.names}


def zingg_diagram(population: Population) -> FormDiagram:
    """Return c/b, b/a and Zingg's class of every body; a ratio of exactly 2/3 is not above the limit.

    References
    ----------
    Zingg (1935), Beitrag zur Schotteranalyse, Schweiz. Mineral. Petrogr. Mitt. 15, 39-140.
    """
    labels, (c, b, a), volumes = _axes(population)
    flatness, elongation = c / b, b / a
    classes = tuple(
        ("equant" if thick else "disc") if broad else ("rod" if thick else "blade")
        for thick, broad in zip(flatness > ZINGG_LIMIT, elongation > ZINGG_LIMIT, strict=True)
    )
    return FormDiagram(labels, flatness, elongation, classes, ZINGG_CLASSES, volumes)


def sneed_folk_diagram(population: Population) -> FormDiagram:
    """Return (a - b) / (a - c), c/a and Sneed and Folk's class of every body.

    A body of three equal axes is compact wherever it lies; its (a - b) / (a - c), 0/0, is stated as 0.5.

    References
    ----------
    Sneed & Folk (1958), Pebbles in the lower Colorado River, Texas, Journal of Geology 66, 114-150.
    """
    labels, (c, b, a), volumes = _axes(population)
    spread = a - c
    side = np.divide(a - b, spread, out=np.full_like(spread, 0.5), where=spread > 0)
    height = c / a
    rows = np.searchsorted(SNEED_FOLK_HEIGHTS, height, side="left")
    columns = np.searchsorted(SNEED_FOLK_SIDES, side, side="right")
    classes = tuple(
        "compact" if row == 3 else SNEED_FOLK_CLASSES[1 + 3 * (2 - row) + column]
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    )
    return FormDiagram(labels, side, height, classes, SNEED_FOLK_CLASSES, volumes)


def _axes(
    population: Population,
) -> tuple[Int[np.ndarray, " bodies"], Sequence[Float[np.ndarray, " bodies"]], Float[np.ndarray, " bodies"]]:
    columns = [population.column(name) for name in ("shortest", "intermediate", "longest", "volume")]
    defined = np.isfinite(np.stack(columns)).all(axis=0)
    c, b, a, volume = (column[defined] for column in columns)
    return population.labels[defined], (c, b, a), volume
