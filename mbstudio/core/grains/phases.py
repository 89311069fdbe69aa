"""Which phases a scan shows, and which of them are grains: from what meets at its interfaces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy import ndimage

from mbstudio.core.grains.interfaces import Interfaces

LEAST_INTERFACES = 30
"""Fewer voxels on interfaces than this may be chance."""
_WIDTH = 0.06  # of the kernel that smooths the density of pairs of levels, in contrasts
_NEAR = 0.25  # how far pairs of one kind lie from the middle of it, in contrasts
_WEAK = 0.2  # pairs of less contrast are texture
_CLEAR = 3.2  # deviations of the noise: contrast of what is no texture
_LEAST_SHARE = 0.03
_BINS = 1500
_SAME_LEVEL = 0.15
_THIN = 0.3  # least contrast of a liquid and the void, over that of grains and liquid
_FITTED = 100_000  # interfaces
_ALIKE = 0.3  # deviation by which a drift may move the sides differently, over its own
_EXPLAINED = 0.6  # share of the variance of levels, on either side, that a drift explains
_DARK = -0.01  # 1 / voxel: median curvature below which the dark side is the convex one


@dataclass(frozen=True)
class Kind:
    """One kind of interface: two levels that meet, and the share of all interfaces that do so."""

    low: float
    high: float
    share: float

    @property
    def contrast(self) -> float:
        return self.high - self.low


@dataclass(frozen=True, eq=False)
class Phases:
    """What a scan consists of.

    Levels are in grey values; where grains are dark, all signs are turned, so that grains are the higher
    ones.

    Attributes
    ----------
    kinds : tuple of Kind
        Of interfaces, the most frequent first.
    void : float
        Level of what lies between the grains.
    tones : tuple of float
        Levels of the grains, the lowest first.
    liquid : float or None
        Level of a phase between void and grain that wets the grains, such as water.
    dark : bool
        Whether grains are darker than what lies between them.
    curvature : float
        Median sum of the principal curvatures of the grains' surfaces, 1 / voxel.
    spread : float
        Between the 10th and the 90th percentile of the middles of grains' interfaces, in contrasts:
        how far one threshold is from serving the whole scan.
    interfaces : Interfaces
        Those of the grains' surfaces.
    """

    kinds: tuple[Kind, ...]
    void: float
    tones: tuple[float, ...]
    liquid: float | None
    dark: bool
    curvature: float
    spread: float
    interfaces: Interfaces

    @property
    def whole_middles(self) -> tuple[Int32[np.ndarray, "w 3"], Float32[np.ndarray, " w"]]:
        """Places and middles of the interfaces both of whose sides are wide enough to show their levels.

        Between grains that nearly touch, the void's own level is not reached: the middle lies too high there.
        """
        whole = _is_whole(self.interfaces)
        return self.interfaces.places[whole], self.interfaces.middles[whole]

    @property
    def base(self) -> float:
        """Level of what the darkest grains are parted from."""
        return self.void if self.liquid is None else self.liquid

    @property
    def contrast(self) -> float:
        """Difference between the darkest grains and what surrounds them."""
        return self.tones[0] - self.base

    @property
    def contrast_to_noise(self) -> float:
        return self.contrast / max(self.interfaces.noise, 1e-300)

    @property
    def count(self) -> int:
        """Number of phases: void, liquid, tones of grains."""
        return 1 + (self.liquid is not None) + len(self.tones)

    @property
    def middle(self) -> float:
        """Half-way between the darkest grains and what surrounds them."""
        return 0.5 * (self.base + self.tones[0])


def find_phases(interfaces: Interfaces, dark: bool | None = None, *, wet: bool = True) -> Phases | None:
    """Tell phases by the levels that meet at interfaces; None where there are too few of these.

    Parameters
    ----------
    interfaces : Interfaces
    dark : bool, optional
        Whether grains are darker than what lies between them; where it is not stated, they are the side whose
        surface is convex in the median.
    wet : bool
        Whether a level between void and grain may be a liquid; otherwise it is that of fainter grains.
    """
    if len(interfaces) < LEAST_INTERFACES:
        return None
    drift = _drift(interfaces)
    interfaces = _shifted(interfaces, -drift)
    kinds, contrast = _kinds(interfaces)
    if not kinds:
        return None
    if dark is None:
        belonging = _match_kinds(interfaces, kinds, contrast)
        dark = _curvature(interfaces, belonging) < _DARK
    if dark:
        interfaces, drift = _turned(interfaces), -drift
        kinds = tuple(Kind(-kind.high, -kind.low, kind.share) for kind in kinds)
    void, tones, liquid = _levels(kinds, contrast, wet)
    base = void if liquid is None else liquid
    surface = _surface(interfaces, base, tones, contrast)
    interfaces = _shifted(interfaces, drift)
    own = replace(
        interfaces,
        places=interfaces.places[surface],
        lows=interfaces.lows[surface],
        highs=interfaces.highs[surface],
        curvatures=interfaces.curvatures[surface],
    )
    if len(own) < LEAST_INTERFACES:
        return None
    whole = own.middles[_is_whole(own)]
    early, late = np.quantile(whole, (0.1, 0.9))
    spread = float(late - early) / max(float(np.median(own.contrasts)), 1e-300)
    curvature = _curvature(own, np.ones(len(own), np.bool_))
    return Phases(kinds, void, tones, liquid, dark, curvature, spread, own)


def _drift(interfaces: Interfaces) -> Float[np.ndarray, " m"]:
    """Return by how much the grey value of everything drifts with the place, such as by cupping; else zeros.

    It is a polynomial of second degree. It counts as a drift only where it moves the darker and the brighter
    sides alike: grains of several tones differ on one side, a liquid on the other.
    """
    none = np.zeros(len(interfaces))
    strong = np.flatnonzero(interfaces.contrasts > 0.5 * np.median(interfaces.contrasts))
    strong = strong[:: -(-len(strong) // _FITTED)] if len(strong) else strong
    if len(strong) < LEAST_INTERFACES:
        return none
    extent = np.maximum(interfaces.places.max(axis=0), 1)
    terms = _terms(interfaces.places[strong] / extent)
    sides = np.stack([interfaces.lows[strong], interfaces.highs[strong]], axis=1).astype(np.float64)
    factors = np.linalg.lstsq(terms, sides, rcond=None)[0]
    found = terms @ factors
    explained = found.var(axis=0) / np.maximum(sides.var(axis=0), 1e-300)
    apart = (found[:, 1] - found[:, 0]).std()
    if explained.min() < _EXPLAINED or apart > _ALIKE * found.mean(axis=1).std():
        return none
    drift: Float[np.ndarray, " m"] = _terms(interfaces.places / extent) @ factors.mean(axis=1)
    drift -= np.median(drift)
    return drift


def _terms(places: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 10"]:
    """Return the terms of a polynomial of second degree, at places between 0 and 1."""
    z, y, x = 2.0 * places.T - 1.0
    return np.stack([np.ones_like(z), z, y, x, z * z, y * y, x * x, z * y, y * x, z * x], axis=1)


def _shifted(interfaces: Interfaces, shift: Float[np.ndarray, " m"]) -> Interfaces:
    """Return interfaces with other levels."""
    if not shift.any():
        return interfaces
    lows, highs = ((side + shift).astype(np.float32) for side in (interfaces.lows, interfaces.highs))
    return replace(interfaces, lows=lows, highs=highs)


def _kinds(interfaces: Interfaces) -> tuple[tuple[Kind, ...], float]:
    """Return the kinds of interfaces, the most frequent first, and the contrast that they are told apart by.

    They are the maxima of the density of pairs (low, high).
    """
    contrasts = interfaces.contrasts.astype(np.float64)
    contrast, strong = _usual_contrast(contrasts, interfaces.noise)
    lows, highs = interfaces.lows[strong].astype(np.float64), interfaces.highs[strong].astype(np.float64)
    step = 0.5 * _WIDTH * contrast
    start, end = float(np.quantile(lows, 1e-3)) - 5 * step, float(np.quantile(highs, 0.999)) + 5 * step
    bins = int(min(np.ceil((end - start) / step), _BINS))
    end = start + bins * step
    density = np.histogram2d(lows, highs, bins=bins, range=[[start, end], [start, end]])[0]
    density = ndimage.gaussian_filter(density, 2.0)
    summits = np.argwhere(
        (density == ndimage.maximum_filter(density, size=13)) & (density > 0.05 * density.max())
    )
    middles = start + (summits + 0.5) * step
    away = np.square(lows[:, None] - middles[:, 0]) + np.square(highs[:, None] - middles[:, 1])
    nearest, near = away.argmin(axis=1), away.min(axis=1) < np.square(_NEAR * contrast)
    kinds = []
    for place in range(len(middles)):
        own = near & (nearest == place)
        if own.mean() > _LEAST_SHARE:
            kinds.append(Kind(float(np.median(lows[own])), float(np.median(highs[own])), float(own.mean())))
    return tuple(sorted(kinds, key=lambda kind: -kind.share)), contrast


def _usual_contrast(contrasts: Float[np.ndarray, " m"], noise: float) -> tuple[float, Bool[np.ndarray, " m"]]:
    """Return the contrast of grains, and which interfaces are neither texture nor heavy minerals.

    It is the median weighted by its square: however much weak texture there is, it does not set the
    scale. Where this leaves out most of what stands out clearly, it is that of a few very bright
    inclusions, which are set aside.
    """
    belonging = np.ones(len(contrasts), np.bool_)
    while True:
        chosen = np.sort(contrasts[belonging])
        weights = np.cumsum(np.square(chosen))
        contrast = float(chosen[np.searchsorted(weights, 0.5 * weights[-1])])
        weak = belonging & (contrasts <= _WEAK * contrast)
        clear = np.count_nonzero(weak & (contrasts > _CLEAR * noise))
        if clear <= 3 * np.count_nonzero(belonging & ~weak):
            return contrast, belonging & ~weak
        belonging = weak


def _match_kinds(interfaces: Interfaces, kinds: tuple[Kind, ...], contrast: float) -> Bool[np.ndarray, " m"]:
    """Return which interfaces are of one of the kinds."""
    belonging = np.zeros(len(interfaces), np.bool_)
    for kind in kinds:
        away = np.square(interfaces.lows - kind.low) + np.square(interfaces.highs - kind.high)
        belonging |= away < np.square(_NEAR * contrast)
    return belonging


def _is_whole(interfaces: Interfaces) -> Bool[np.ndarray, " m"]:
    contrasts = interfaces.contrasts
    return np.asarray(contrasts >= np.median(contrasts))


def _curvature(interfaces: Interfaces, chosen: Bool[np.ndarray, " m"]) -> float:
    curvatures: Float[np.ndarray, " m"] = interfaces.curvatures[chosen]
    return float(np.median(np.clip(curvatures, -1.0, 1.0))) if len(curvatures) else 0.0


def _turned(interfaces: Interfaces) -> Interfaces:
    """Return the interfaces of the negative image."""
    return replace(
        interfaces,
        lows=-interfaces.highs,
        highs=-interfaces.lows,
        curvatures=-interfaces.curvatures,
    )


def _levels(
    kinds: tuple[Kind, ...], contrast: float, wet: bool
) -> tuple[float, tuple[float, ...], float | None]:
    """Return the level of the void, those of the grains, and that of a liquid if there is one.

    A level that is the bright side of some interfaces and the dark side of others lies between two
    phases. It is a liquid if it meets the brighter phase at least half as often as the void: inclusions
    in grains are fewer. What does not meet the void itself is none: streaks within grains do not.
    """
    void = min(kind.low for kind in kinds if kind.share > 0.1)
    liquid: float | None = None
    for outer in kinds:
        if not wet or outer.low > void + _SAME_LEVEL * contrast:
            continue
        for inner in kinds:
            meets = abs(outer.high - inner.low) < _SAME_LEVEL * contrast
            between = inner.low - outer.low > max(_SAME_LEVEL * contrast, _THIN * inner.contrast)
            if meets and between and inner.share >= 0.5 * outer.share:
                void, liquid = min(void, outer.low), inner.low
    base = void if liquid is None else liquid
    tones: list[float] = []
    for kind in sorted(kinds, key=lambda kind: kind.high):
        # Grains stand out from the void or, where they touch, from fainter grains.
        known = (base, *([] if wet else tones))
        beside = min(abs(kind.low - level) for level in known) <= 2 * _SAME_LEVEL * contrast
        if not beside or kind.high < base + _WEAK * contrast:
            continue
        if not tones or kind.high > tones[-1] + 0.2 * (tones[0] - base):
            tones.append(kind.high)
    if not tones:
        tones = [kinds[0].high]
    return void, tuple(tones), liquid


def _surface(
    interfaces: Interfaces, base: float, tones: tuple[float, ...], contrast: float
) -> Bool[np.ndarray, " m"]:
    """Return which interfaces are surfaces of grains, rather than texture or borders between grains."""
    step = tones[0] - base
    strong = interfaces.contrasts > _NEAR * min(step, contrast)
    if len(tones) > 1:
        return np.asarray(strong & (np.abs(interfaces.lows - base) < 0.35 * step))
    if base > interfaces.lows.min() + step:  # wetted grains: the liquid's own surface lies deeper
        return np.asarray(strong & (np.abs(interfaces.highs - tones[0]) < 0.3 * step))
    return np.asarray(strong)
