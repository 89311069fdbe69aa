"""A population: many bodies of one kind, measured alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.units import conversion_factor, parse_unit

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["grains", "avatars", "clones"]
Weighting = Literal["number", "volume"]


@dataclass(frozen=True, eq=False)
class Population:
    """The factors of many bodies, one row a body.

    Attributes
    ----------
    name : str
        As legends and tables call it.
    kind : {'grains', 'avatars', 'clones'}
    labels : int array, shape (bodies,)
        Each body's label; its place among the bodies where it has none.
    factors : mapping of str to float array, shape (bodies,)
        By their names in `FACTORS`: the core ones and, if measured, the detailed ones and bands. NaN where
        a body could not be measured or a factor is not defined. Read-only.
    unit : str
        Unit of the lengths; areas and volumes are in its powers.
    axes : str
        Convention of the axis lengths, as in `ShapeFactors`.
    surface : str
        What the areas were measured on, as in `ShapeFactors`; several, joined by commas.
    reasons : tuple of str
        Why a body could not be measured; empty where it was.
    warnings : tuple of str
        What to mind about a body's numbers; empty if nothing.

    Raises
    ------
    MeasureError
        If the columns are not of one length.
    """

    name: str
    kind: Kind
    labels: Int[np.ndarray, " bodies"]
    factors: Mapping[str, Float[np.ndarray, " bodies"]]
    unit: str
    axes: str
    surface: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]

    def __post_init__(self) -> None:
        labels = np.array(self.labels, dtype=np.int64)
        columns = {name: np.array(column, dtype=np.float64) for name, column in self.factors.items()}
        lengths = {len(labels), len(self.reasons), len(self.warnings), *map(len, columns.values())}
        if len(lengths) > 1:
            raise MeasureError(
                f"Population '{self.name}': labels, factors, reasons and warnings must have the same length, "
                f"not {sorted(lengths)}."
            )
        for array in (labels, *columns.values()):
            array.flags.writeable = False
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "factors", MappingProxyType(columns))

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def measured(self) -> Bool[np.ndarray, " bodies"]:
        """Which bodies could be measured."""
        return np.array([not reason for reason in self.reasons], dtype=bool)

    @property
    def failures(self) -> dict[int, str]:
        """Why bodies could not be measured, by label."""
        return {int(label): reason for label, reason in zip(self.labels, self.reasons, strict=True) if reason}

    def column(self, factor: str) -> Float[np.ndarray, " bodies"]:
        """Return one factor of every body, NaN where there is none.

        Raises
        ------
        MeasureError
            If the population holds no such factor.
        """
        if factor not in self.factors:
            raise MeasureError(
                f"Population '{self.name}' has no factor '{factor}': use one of {', '.join(self.factors)}."
            )
        return self.factors[factor]

    def values(self, factor: str) -> Float[np.ndarray, " defined"]:
        """Return one factor of the bodies that have it, in the order of the rows."""
        column = self.column(factor)
        finite: np.ndarray = column[np.isfinite(column)]
        return finite

    def weights(self, factor: str, by: Weighting = "number") -> Float[np.ndarray, " defined"]:
        """Return the shares, of sum 1, that go with `values`: equal, or by volume (mass at one density)."""
        defined = np.isfinite(self.column(factor))
        if by == "number":
            weights = np.ones(int(defined.sum()))
        elif by == "volume":
            weights = self.column("volume")[defined]
        else:
            raise MeasureError(f"Bodies are weighted by 'number' or 'volume', not by '{by}'.")
        return weights / weights.sum() if len(weights) else weights

    def rows(self, labels: Sequence[int]) -> Population:
        """Return the population of only these labels, in the order of this one's rows.

        Raises
        ------
        MeasureError
            If a label is not among them.
        """
        missing = sorted(set(labels) - set(self.labels.tolist()))
        if missing:
            raise MeasureError(f"Population '{self.name}' has no body {missing[0]}.")
        chosen = np.flatnonzero(np.isin(self.labels, list(labels)))
        return Population(
            self.name, self.kind, self.labels[chosen],
            {name: column[chosen] for name, column in self.factors.items()},
            self.unit, self.axes, self.surface,
            tuple(self.reasons[i] for i in chosen), tuple(self.warnings[i] for i in chosen),
        )  # fmt: skip

    def in_unit(self, unit: str) -> Population:
        """Return the population with its lengths, areas and volumes in another unit.

        Raises
        ------
        UnitError
            If one of the two is no length unit.
        """
        scale = conversion_factor(self.unit, unit)
        columns = {
            name: column * scale ** (FACTORS[name].power if name in FACTORS else 0)
            for name, column in self.factors.items()
        }
        return replace(self, factors=columns, unit=parse_unit(unit))

    def table(self) -> pd.DataFrame:
        """Return a table of one row a body; columns state their units (``volume_mm3``).

        Beside the factors: ``label``, ``unit``, ``axes``, ``surface``, ``warning``, ``not_measured`` (why).
        """
        import pandas as pd

        columns: dict[str, object] = {"label": self.labels}
        columns.update({FACTORS[name].column(self.unit): column for name, column in self.factors.items()})
        stated = {"unit": self.unit, "axes": self.axes, "surface": self.surface}
        columns.update(stated)
        columns["warning"] = list(self.warnings)
        columns["not_measured"] = list(self.reasons)
        return pd.DataFrame(columns)
