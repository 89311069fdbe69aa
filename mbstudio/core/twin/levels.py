"""What a scan looks like: the level of its pores, the tones of its grains, and the noise of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from mbstudio.core.errors import TwinError

ToneModel = Literal["constant", "linear"]

_FEWEST_PORES = 20
_MOST_PORES = 200_000
_PORE_DISTANCES = (3.0, 2.0, 1.0)  # voxels from all grains
_CORE_DEPTH = 3.0  # voxels
_FEWEST_OF_CORE = 60
_MOST_SATURATED = 0.05  # of a core's voxels at the end of the range
_MOST_CUT = 0.5  # of the pores' voxels at the other end: with more their median is not known
_TOLD_CUT = 0.05
_LEAST_NOISE = 0.004  # contrasts: below it the model's own errors decide
_LEAST_CONTRAST = 1.0  # deviations of the noise
_LEAST_DRIFT = 0.01  # contrasts that a tone changes by from a grain's middle to its surface
_LEAST_BETTER = 0.002  # of the variance in the cores that a linear tone must explain, seen on other voxels
_LEAST_CUPPING = 0.02  # contrasts between the lowest and the highest void level


@dataclass(frozen=True, eq=False)
class Levels:
    """Grey levels of a scan.

    Attributes
    ----------
    void : float
        Median of the pores.
    void_by_place : float array, shape (10,)
        The void level in x, y, z over the scan from -1 to 1, less `void`: 1, x, y, z, xx, yy, zz, xy, xz, yz;
        zeros where it is constant.
    contrast : float
        Median tone of the grains less `void`; negative where grains are the darker.
    tones : mapping of int to float
        Tone of each grain at its middle, by label.
    tone_model : {'constant', 'linear'}
        Whether a grain's tone may change linearly from place to place.
    void_noise, grain_noise : float
        Standard deviations in pores and in the cores of grains.
    notes : tuple of str
        What is to be minded, in sentences.
    """

    void: float
    void_by_place: Float64[np.ndarray, "10"]
    contrast: float
    tones: dict[int, float]
    tone_model: ToneModel
    void_noise: float
    grain_noise: float
    notes: tuple[str, ...] = ()

    @property
    def void_model(self) -> str:
        """Whether the void level is 'constant' or 'quadratic' over the scan."""
        return "quadratic" if self.void_by_place.any() else "constant"


def spread(values: np.ndarray) -> float:
    """Return the standard deviation of values as their median deviation tells it."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def find_pores(
    labels: Int[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]
) -> Bool[np.ndarray, "Z Y X"]:
    """Return the voxels of pores that no grain's blur reaches, or as far from the grains as there are some.

    Raises
    ------
    TwinError
        If there is no voxel outside the grains.
    """
    import edt

    pores = (labels == 0) & seen
    if int(np.count_nonzero(pores)) < _FEWEST_PORES:
        raise TwinError(
            f"The labels leave {int(np.count_nonzero(pores))} pore voxels, and a void level needs "
            f"{_FEWEST_PORES}: label the pores 0."
        )
    away = edt.edt(labels == 0, parallel=1)
    for least in _PORE_DISTANCES:
        far: np.ndarray = pores & (away > least)
        if int(np.count_nonzero(far)) >= _FEWEST_PORES:
            return far
    return np.asarray(pores)


def place_terms(places: np.ndarray, shape: tuple[int, int, int]) -> Float64[np.ndarray, "m 10"]:
    """Return the ten terms of a quadratic at voxels (z, y, x) of a scan."""
    z, y, x = (2.0 * places[:, a] / max(shape[a] - 1, 1) - 1.0 for a in range(3))
    return np.stack((np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z), axis=1)


def void_shape(
    voxels: Float32[np.ndarray, "Z Y X"], pores: Bool[np.ndarray, "Z Y X"], contrast: float
) -> tuple[float, Float64[np.ndarray, "10"]]:
    """Return the void level's median and its quadratic, zeros where it changes too little to matter."""
    flat = np.flatnonzero(pores.ravel())
    flat = flat[:: max(1, len(flat) // _MOST_PORES)]
    values = voxels.ravel()[flat].astype(np.float64)
    void = float(np.median(values))
    if len(flat) < 1000:
        return void, np.zeros(10)
    terms = place_terms(np.stack(np.unravel_index(flat, pores.shape), axis=1), pores.shape)
    kept = np.abs(values - void) < 5 * max(spread(values), 1e-12)
    solved = np.linalg.lstsq(terms[kept], values[kept] - void, rcond=None)[0]
    shown = terms @ solved
    low, high = np.percentile(shown, (2, 98))
    if high - low < _LEAST_CUPPING * abs(contrast):
        return void, np.zeros(10)
    return void, solved


def require_grey(voxels: np.ndarray, seen: Bool[np.ndarray, "Z Y X"]) -> None:
    """Refuse a scan without grey values.

    Raises
    ------
    TwinError
        If its voxels hold no more than two values, or some that are not finite.
    """
    values = voxels[seen]
    if not np.isfinite(values).all():
        raise TwinError("The scan holds voxels that are not finite numbers: mark them as outside its view.")
    low, high = float(values.min()), float(values.max())
    if not ((values != low) & (values != high)).any():
        raise TwinError(
            "The scan holds two values only: a twin needs grey values. Fit avatars to the labels instead."
        )


def core_of(mask: Bool[np.ndarray, "z y x"]) -> Bool[np.ndarray, "z y x"]:
    """Return the voxels of a grain that no pore's blur reaches, or its deepest ones."""
    import edt

    depth = edt.edt(np.pad(mask, 1), parallel=1)[1:-1, 1:-1, 1:-1]
    deep = np.asarray(depth > min(_CORE_DEPTH, 0.6 * float(depth.max())))
    return deep if deep.any() else mask


def require_unsaturated(label: int, core: np.ndarray, end: float, side: str) -> None:
    """Refuse a grain whose tone the scan's range cuts off.

    Parameters
    ----------
    label : int
    core : array
        Grey values.
    end : float
        The scan's highest value, or its lowest where grains are the darker.
    side : str
        'highest' or 'lowest'.

    Raises
    ------
    TwinError
        If more than a few voxels of its core have that value.
    """
    if float(np.mean(core == end)) > _MOST_SATURATED:
        raise TwinError(
            f"Grain {label} is saturated: its voxels are at the scan's {side} value {end:g}. "
            "Export the scan with a wider grey range, or exclude the grain."
        )


def noise_of_pores(values: np.ndarray, end: float, side: str) -> tuple[float, tuple[str, ...]]:
    """Return the noise of pores that the scan's range may cut off at `end`, and what to mind of it.

    Where a part of them is cut off the noise is that of the other side; their median is still right.

    Raises
    ------
    TwinError
        If more than half of them have the end's value: then their level is not known.
    """
    share = float(np.mean(values == end))
    if share <= _TOLD_CUT:
        return spread(values), ()
    if share > _MOST_CUT:
        raise TwinError(
            f"{100 * share:.0f} % of the pore voxels are at the scan's {side} value {end:g}: its range cuts "
            "the pores off, and their level is not known. Export the scan with a wider grey range."
        )
    middle = float(np.median(values))
    other = values[values > middle] if side == "lowest" else values[values < middle]
    noise = 1.4826 * float(np.median(np.abs(other - middle))) if len(other) else 0.0
    told = (
        f"{100 * share:.0f} % of the pore voxels are at the scan's {side} value {end:g}: surfaces may lie "
        "too far outside. Export the scan with a wider grey range."
    )
    return noise, (told,)


class ToneTrial:
    """Whether the tones of grains change from place to place: half of each core says it of the other."""

    def __init__(self) -> None:
        self._constant = self._linear = 0.0
        self._drifts: list[float] = []

    def add(self, values: np.ndarray, places: Float64[np.ndarray, "m 3"], radius: float) -> None:
        """Take a core's voxels in; `places` are from the grain's middle."""
        if len(values) < _FEWEST_OF_CORE:
            return
        terms = np.column_stack((np.ones(len(values)), places / radius))
        # Halves by blocks of two voxels: neighbours share their noise.
        half = (np.floor(places / 2.0).sum(axis=1).astype(int) & 1).astype(bool)
        if half.sum() < 20 or (~half).sum() < 20:
            return
        for learned, tested in ((half, ~half), (~half, half)):
            solved = np.linalg.lstsq(terms[learned], values[learned], rcond=None)[0]
            rest = np.clip(np.abs(values[tested] - terms[tested] @ solved), 0, None)
            plain = np.abs(values[tested] - values[learned].mean())
            self._linear += float((rest**2).sum())
            self._constant += float((plain**2).sum())
            self._drifts.append(float(np.linalg.norm(solved[1:])))

    def decide(self, contrast: float) -> ToneModel:
        """Return the model that the scan shows."""
        if not self._drifts or self._constant <= 0:
            return "constant"
        better = 1.0 - self._linear / self._constant
        drifts = float(np.median(self._drifts)) > _LEAST_DRIFT * abs(contrast)
        return "linear" if drifts and better > _LEAST_BETTER else "constant"


def require_contrast(contrast: float, noise: float) -> None:
    """Refuse grains that look like pores.

    Raises
    ------
    TwinError
        If their tone is not a deviation of the noise away from the void level.
    """
    if not abs(contrast) > _LEAST_CONTRAST * noise:
        raise TwinError(
            f"Grains and pores differ by {abs(contrast):.4g} with a noise of {noise:.4g}: check that the "
            "labels belong to this scan."
        )


def least_noise(noise: float, contrast: float) -> float:
    """Return a noise that no rounding makes too small to weigh voxels by."""
    return max(noise, _LEAST_NOISE * abs(contrast))
