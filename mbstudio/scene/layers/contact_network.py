"""The contact network: a rod from grain to grain for each contact, coloured by what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyvista as pv
from jaxtyping import Bool, Float, Int

from mbstudio.core.translation import mark
from mbstudio.core.twin.fabric import LEAST_PROBABILITY
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.scene.layers.colour_scale import ColourScale, readable_unit, sequential_colours
from mbstudio.scene.layers.layer import Hit, Layer, Stage
from mbstudio.scene.theme import SceneTheme

Measure = Literal["gap", "gap_deviation", "probability", "area"]
MEASURES: dict[Measure, str] = {
    "gap": mark("Gap"),
    "gap_deviation": mark("Deviation of the gap"),
    "probability": mark("Probability of contact"),
    "area": mark("Contact area"),
}
_SHOWN = (2.0, 98.0)  # percentiles that the colours reach to
_THICK, _THIN, _NODE = 0.035, 0.012, 0.09  # of the median length of rods


@dataclass(frozen=True, eq=False)
class Network:
    """Rods between the middles of grains.

    Attributes
    ----------
    middles : float array, shape (g, 3)
        Of all grains.
    ends : int array, shape (m, 2)
        Which grains each rod joins.
    touches : bool array, shape (m,)
        Whether the two are in contact; rods of others are thin.
    values : float array, shape (m,)
        By which rods are coloured.
    measure : str
        What the values are.
    unit : str
        Canonical unit of all lengths.
    """

    middles: Float[np.ndarray, "g 3"]
    ends: Int[np.ndarray, "m 2"]
    touches: Bool[np.ndarray, "m"]
    values: Float[np.ndarray, "m"]
    measure: Measure
    unit: str


def network_of(twin: KeptTwin, measure: Measure = "gap") -> Network:
    """Return the network of a twin's pairs."""
    table, place = twin.contacts, {label: number for number, label in enumerate(twin.middles)}
    ends = np.array(
        [(place[a], place[b]) for a, b in zip(table["a"].tolist(), table["b"].tolist(), strict=True)], int
    ).reshape(-1, 2)
    touches = table["probability"].to_numpy(float) >= LEAST_PROBABILITY
    middles = np.array(list(twin.middles.values()), dtype=float).reshape(-1, 3)
    return Network(middles, ends, touches, table[measure].to_numpy(float), measure, twin.unit)


class ContactNetwork(Layer[Network]):
    """Contacts as rods, near misses as thin ones.

    Attributes
    ----------
    scale : ColourScale
    range : tuple of float
        Values at the ends of the scale.
    """

    title = mark("Contacts")
    icon = "ph.share-network"
    tip = mark("Contact network of the twin: rods between grains; thin ones nearly touch")
    starts_shown = False
    is_within_scan = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.scale = ColourScale(stage.renderer, stage.theme, sequential_colours())
        self.range = (0.0, 1.0)
        self._rods: pv.Actor | None = None
        self._nodes: pv.Actor | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [actor for actor in (self._rods, self._nodes) if actor is not None]

    def set(self, content: Network | None, unit: str | None = None) -> None:
        for actor in self.actors:
            self.stage.remove(actor)
        self._rods = self._nodes = None
        if content is not None and len(content.ends):
            self.stage.set_unit(content.unit)
            self._add(content)
            self._explain(content)
        self.stage.update()

    def refresh(self) -> None:
        super().refresh()
        self.scale.set_visible(self.holds_something and self.is_visible)

    def recolour(self, theme: SceneTheme) -> None:
        self.scale.recolour(theme)
        if self._nodes is not None:
            self._nodes.prop.color = theme.muted

    def set_pixel_ratio(self, ratio: float) -> None:
        self.scale.pixel_ratio = ratio

    def pick(self, x: float, y: float) -> Hit | None:
        """Return None: a click means the grains, not what lies between them."""
        return None

    def close(self) -> None:
        super().close()
        self.scale.remove()

    def _add(self, shown: Network) -> None:
        points = shown.middles[shown.ends]
        length = float(np.median(np.linalg.norm(points[:, 1] - points[:, 0], axis=1)))
        known = shown.values[np.isfinite(shown.values)]
        low, high = np.percentile(known, _SHOWN) if len(known) else (0.0, 1.0)
        if shown.measure == "probability":
            low, high = 0.0, 1.0
        self.range = (float(low), float(high if high > low else low + max(abs(low), 1e-12)))
        parts = []
        for some, share in ((shown.touches, _THICK), (~shown.touches, _THIN)):
            if some.any():
                lines = pv.PolyData(points[some].reshape(-1, 3).astype(np.float32))
                count = int(some.sum())
                lines.lines = np.column_stack(
                    (np.full(count, 2), np.arange(0, 2 * count, 2), np.arange(1, 2 * count, 2))
                ).ravel()
                lines.point_data["value"] = np.repeat(shown.values[some], 2).astype(np.float32)
                parts.append(lines.tube(radius=share * length, n_sides=10, capping=True))
        rods: Any = parts[0] if len(parts) == 1 else parts[0].append_polydata(parts[1])
        colours = np.column_stack([sequential_colours(255), np.full(255, 255, np.uint8)])
        table = pv.LookupTable(values=colours, scalar_range=self.range)
        how = {"reset_camera": False, "render": False, "pickable": False, "show_scalar_bar": False}
        self._rods = self.stage.plotter.add_mesh(
            rods, name=self.name, scalars="value", cmap=table, smooth_shading=True, ambient=0.25, **how
        )
        balls = pv.PolyData(shown.middles.astype(np.float32)).glyph(
            geom=pv.Sphere(radius=_NODE * length, theta_resolution=14, phi_resolution=14),
            orient=False, scale=False,
        )  # fmt: skip
        self._nodes = self.stage.plotter.add_mesh(
            balls, name=f"{self.name} nodes", color=self.stage.theme.muted, smooth_shading=True, **how
        )
        for actor in self.actors:
            actor.prop.opacity = self.opacity

    def _explain(self, shown: Network) -> None:
        """Tell what the colours mean."""
        low, high = self.range
        values = np.linspace(low, high, 5)
        if shown.measure == "probability":
            factor, label, power = 100.0, "%", 1
        else:
            size = max(abs(low), abs(high))
            power = 2 if shown.measure == "area" else 1
            factor, label = readable_unit(size ** (1 / power), shown.unit)
        label = f"{label}²" if power == 2 else label
        told = f"{int(shown.touches.sum())} contacts\n{int((~shown.touches).sum())} near misses"
        ticks = [f"{value * factor**power:.3g}" for value in values]
        self.scale.explain(f"{MEASURES[shown.measure]} ({label})", ticks, told)
