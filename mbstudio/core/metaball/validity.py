"""Whether an avatar is a valid particle, and how true it is to its grain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.neck import smallest_neck
from mbstudio.core.metaball.surface import volume_and_area_of_thin
from mbstudio.core.metaball.topology import Topology, topology
from mbstudio.core.units import conversion_factor

MOST_VOLUME_ERROR = 0.05
MOST_RMS = 0.08  # of the RMS radius
FEWEST_VOXELS = 20
"""A control point that has failed: with fewer, more control points would only follow the voxels' steps."""
FEWEST_VOXELS_OF_ADVICE = 6
"""A control point of the number that the shape needs: sheets one voxel thick have fewer."""


@dataclass(frozen=True)
class Verdict:
    """Whether an avatar is a valid particle, and how true it is.

    Attributes
    ----------
    valid : bool
        One piece, no void (but those that were kept on purpose), every control point inside, volume
        within 5 %.
    pieces, voids : int
        Connected pieces of the solid, and cavities inside it.
    genus : int or None
        Number of handles, from the Euler characteristic of the surface; None if unknown.
    points_outside : int
        Control points outside the grain.
    volume_error : float
        (V_avatar - V_grain) / V_grain.
    rms : float
        Root mean square surface distance in the grain's unit.
    reasons : tuple of str
        Why it is not valid, and what to do, in words for the user; empty when valid.
    warnings : tuple of str
        What the user should know though it makes no avatar invalid: cavities filled or kept, handles
        that differ from the grain's.
    smallest_neck : float or None
        Diameter in the avatar's unit of the thinnest place between two thicker parts; of the
        largest inscribed sphere if there is none; 0 for several pieces; None if unknown.
    grain_genus : int or None
        Number of handles of the grain's voxels; None if unknown.
    """

    valid: bool
    pieces: int
    voids: int
    genus: int | None
    points_outside: int
    volume_error: float
    rms: float
    reasons: tuple[str, ...] = ()
    smallest_neck: float | None = None
    grain_genus: int | None = None
    warnings: tuple[str, ...] = ()


def points_outside(avatar: Avatar, grain: Grain) -> int:
    """Return how many control points lie in no voxel of the grain."""
    factor = conversion_factor(avatar.unit, grain.unit)
    index = np.rint((avatar.centers * factor - np.asarray(grain.origin)) / grain.voxel_size.xyz).astype(int)[
        :, ::-1
    ]
    shape = np.array(grain.mask.shape)
    within = ((index >= 0) & (index < shape)).all(axis=1)
    inside = np.zeros(avatar.n, dtype=bool)
    inside[within] = np.asarray(grain.mask)[tuple(index[within].T)].astype(bool)
    return int(avatar.n - np.count_nonzero(inside))


def _advise(n: int, grain: Grain | None, needed: Callable[[], int] | None) -> str:
    """Return what to do about an avatar of `n` control points that is not valid."""
    # More than the estimate where that many have failed already; in tens, for it is no exact number.
    wanted = max(2 * n, -(-needed() // 10) * 10 if needed is not None else 0)
    if grain is not None and grain.voxel_count < max(FEWEST_VOXELS * n, FEWEST_VOXELS_OF_ADVICE * wanted):
        return (
            f"its {grain.voxel_count} voxels are too few for a more accurate avatar: "
            "scan with smaller voxels or leave it out"
        )
    return f"n is too small for this shape: try {wanted}"


def _warnings(kept: int, filled: int, voids: int) -> tuple[str, ...]:
    told = []
    if filled:
        told.append(
            f"Cavities of {filled} voxels inside the grain were filled: the avatar is solid there. "
            "Fit with cavities='keep' (--cavities keep) to keep them."
        )
    if kept:
        told.append(
            f"The grain's cavities ({kept}) were kept as requested, and the avatar has {voids}: "
            "its volume and mass exclude them."
        )
    return tuple(told)


def check(
    avatar: Avatar,
    grain: Grain | None = None,
    *,
    rms: float = float("nan"),
    cells: int = 64,
    found: Topology | None = None,
    outside: int | None = None,
    asked: int | None = None,
    grain_genus: int | None = None,
    needed: Callable[[], int] | None = None,
    kept: int = 0,
    filled: int = 0,
) -> Verdict:
    """Judge an avatar: pieces, voids, handles, necks, control points outside, volume error.

    Parameters
    ----------
    avatar : Avatar
    grain : Grain, optional
        The grain that it stands for; without it volume error and points outside are not judged
        (volume error NaN, points outside 0).
    rms : float
        Root mean square surface distance in the avatar's unit, where the caller knows it.
    cells : int
        Grid cells on the longest side to begin with.
    found : Topology, optional
        The avatar's topology where it is known already.
    outside : int, optional
        Control points outside the grain where the caller has counted them (a grain whose
        cavities were filled); counted here otherwise.
    asked : int, optional
        Control points that were asked for, where the avatar may hold fewer.
    grain_genus : int, optional
        Handles of the grain where the caller has counted them; not compared otherwise.
    needed : callable, optional
        Estimates how many control points the grain's shape needs; called only for advice.
    kept : int
        Cavities of the grain that were kept on purpose: so many voids are no fault.
    filled : int
        Voxels of cavities that were filled, of which the verdict then warns.
    """
    found = found or topology(avatar.control, cells)
    volume_error, counted = float("nan"), 0
    if grain is not None:
        volume, _ = volume_and_area_of_thin(avatar.control, max(cells - 16, 40))
        whole = grain.volume + (filled - grain.filled_voxels if filled else 0) * grain.voxel_size.volume
        volume_error = volume * conversion_factor(avatar.unit, grain.unit) ** 3 / whole - 1.0
        counted = points_outside(avatar, grain) if outside is None else outside
    too_rough = grain is not None and rms > MOST_RMS * 0.5 * grain.nominal_diameter * conversion_factor(
        grain.unit, avatar.unit
    )
    reasons = []
    if found.pieces > 1 or found.voids > kept or abs(volume_error) > MOST_VOLUME_ERROR or too_rough:
        cure = _advise(max(avatar.n, asked or 0), grain, needed)
    if found.pieces > 1:
        reasons.append(f"The avatar is in {found.pieces} pieces: {cure}.")
    if found.voids > kept:
        cavities = "a cavity" if found.voids == 1 else f"{found.voids} cavities"
        reasons.append(f"The avatar has {cavities} inside: {cure}.")
    if counted:
        points = "1 control point lies" if counted == 1 else f"{counted} control points lie"
        reasons.append(f"{points} outside the grain: fit it again with method 'fast'.")
    if abs(volume_error) > MOST_VOLUME_ERROR:
        reasons.append(f"The volume differs by {100 * volume_error:+.1f} %: {cure}.")
    if too_rough:
        reasons.append(f"The surface is off by {rms:.3g} {avatar.unit} (rms): {cure}.")
    warnings = _warnings(kept, filled, found.voids)
    if grain_genus is not None and found.genus != grain_genus:
        told = f"The avatar has {_handles(found.genus)}, the grain {_handles(grain_genus)}"
        warnings = (*warnings, f"{told}: {_advise(max(avatar.n, asked or 0), grain, needed)}.")
    return Verdict(
        valid=not reasons, pieces=found.pieces, voids=found.voids, genus=found.genus, points_outside=counted,
        volume_error=volume_error, rms=rms, reasons=tuple(reasons),
        smallest_neck=smallest_neck(avatar.control) if found.pieces == 1 else 0.0,
        grain_genus=grain_genus, warnings=warnings,
    )  # fmt: skip


def _handles(count: int) -> str:
    return {0: "no handle", 1: "1 handle"}.get(count, f"{count} handles")
