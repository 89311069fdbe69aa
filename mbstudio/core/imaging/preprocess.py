"""From a grain's voxels to what the search works on: signed distance, hull points, scale.

All lengths are physical (so that anisotropic voxels are honoured), then shifted to the centre of
the hull points and divided by their root mean square radius: the *working frame*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import FitError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.hull import outermost_voxels, points_on_surface, tips_of
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.topology import genus_of_voxels
from mbstudio.core.options import Option

Cavities = Literal["fill", "keep"]

CAVITIES = Option(
    "fill",
    "Fill cavities that the grain encloses, with a warning in the verdict, or let the avatar have them: "
    "a void for each, as far as n allows, which then does not make the avatar invalid.",
    choices=get_args(Cavities),
)
"""What both methods can do about cavities."""

PAD = 6
_MOST_INTERIOR = 800
_SMALL_DIAMETER = 40.0  # voxels; below it the hull is smoothed less
_SMOOTHING_OF_FEW = 0.6  # of a grain below it
_LONG_VOXELS = 1.5  # longest edge over shortest
_THIN = 0.35  # thickness in working lengths
_SMOOTHING_OF_BLOCKS = 0.5  # block averages are smooth already: more only rounds the edges


@dataclass(frozen=True, eq=False)
class PreparedGrain:
    """A grain made ready for Metaball-Imaging (VCP and TOC of the paper's pre-processing).

    Attributes
    ----------
    grain : Grain
    mask : bool array, shape (Z, Y, X)
        Padded, possibly coarsened grain, its cavities filled or kept.
    distance : float array, shape (Z, Y, X)
        Signed distance to the surface, positive inside, in working lengths.
    origin, spacing : float array, shape (3,)
        First voxel's centre and edge lengths (x, y, z) in the working frame.
    voxel : float
        Edge of a cube of a voxel's volume, in working lengths.
    fineness : float
        What the surface's place is known to, in working lengths: the edge of a voxel of the scan,
        which averaging in blocks keeps, but no less than half of `voxel`, as `distance` is coarser.
    hull : float array, shape (m, 3)
        Points on the surface, H in the paper, in the working frame. Unless voxels are few or long,
        neighbours in this order are neighbours on the surface: every k-th is spread evenly too.
    tips, tip_shares : float array, shapes (t, 3) and (t,)
        Where the surface touches planes that come from all sides, in the working frame, and the share of the
        planes that each touches: the sharper, the more. They decide on calipers and boxes. None where voxels
        are few or long.
    interior, interior_depth : float array, shapes (p, 3) and (p,)
        Points well inside and their depth.
    volume, area : float
        Volume by counting the scan's own voxels, and area of the surface that the hull points lie on
        (NaN where voxels are too few or too long to tell it), in working lengths cubed and squared.
    thickness : float
        2 V / A in working lengths: the thickness of a sheet, half that of a rod.
    center : float array, shape (3,)
        Centre of the working frame in the grain's frame and unit.
    scale : float
        Length of one working length in the grain's unit.
    filled : int
        Voxels of the working grid in cavities that were filled.
    cavities : int
        Cavities that were kept.
    """

    grain: Grain
    mask: Bool[np.ndarray, "Z Y X"]
    distance: Float32[np.ndarray, "Z Y X"]
    origin: Float64[np.ndarray, "3"]
    spacing: Float64[np.ndarray, "3"]
    voxel: float
    fineness: float
    hull: Float64[np.ndarray, "m 3"]
    tips: Float64[np.ndarray, "t 3"]
    tip_shares: Float64[np.ndarray, "t"]
    interior: Float64[np.ndarray, "p 3"]
    interior_depth: Float64[np.ndarray, "p"]
    volume: float
    area: float
    thickness: float
    center: Float64[np.ndarray, "3"]
    scale: float
    filled: int
    cavities: int = 0

    @property
    def deepest(self) -> float:
        """Radius of the largest inscribed sphere, in working lengths."""
        return float(self.distance.max())

    @cached_property
    def genus(self) -> int | None:
        """Number of handles of :attr:`shape`; not counted of a grain with cavities."""
        return None if self.cavities else genus_of_voxels(self.shape)

    @cached_property
    def shape(self) -> Bool[np.ndarray, "Z Y X"]:
        """The voxels (joined through corners as well), smoothed where that leaves fewer handles.

        Noise makes handles of one voxel on rough faces, which are none of the grain: what a Gaussian
        of one voxel of the scan takes away does not count.
        """
        import cc3d
        import fill_voids
        from scipy.ndimage import gaussian_filter

        genus = genus_of_voxels(self.mask)
        if genus == 0:
            return self.mask
        sigma = np.cbrt(self.grain.voxel_size.volume) / self.scale / self.spacing[::-1]
        smooth = gaussian_filter(self.mask.astype(np.float32), sigma, truncate=3.0) > 0.5
        smooth = fill_voids.fill(cc3d.largest_k(smooth, 1, connectivity=26) > 0, in_place=False)
        return smooth if 0 <= genus_of_voxels(smooth) < genus else self.mask

    @property
    def filled_voxels(self) -> int:
        """Voxels of the scan in cavities that were filled, here or when the grain was made."""
        blocks = np.rint(self.spacing * self.scale / self.grain.voxel_size.xyz)
        return self.grain.filled_voxels + self.filled * int(blocks.prod())

    @property
    def slenderness(self) -> float:
        """How many times thinner the body is than one that counts as thin; at least 1."""
        return max(1.0, _THIN / self.thickness)

    def avatar(self, control: Float64[np.ndarray, "4 n"]) -> Avatar:
        """Return control points (rows x, y, z, k in the working frame) as an avatar over the scan."""
        return Avatar(
            centers=control[:3].T * self.scale + self.center, weights=control[3] * self.scale**2,
            unit=self.grain.unit, label=self.grain.label, name=self.grain.name,
        )  # fmt: skip


@compiled()
def _block_average(mask: np.ndarray, fz: int, fy: int, fx: int, out: np.ndarray) -> None:
    """Add the share of each block of voxels that is inside; `out` starts at zero and has a margin of PAD."""
    nz, ny, nx = mask.shape
    share = np.float32(1.0 / (fz * fy * fx))
    for iz in range(nz):
        for iy in range(ny):
            row = out[6 + iz // fz, 6 + iy // fy]
            for ix in range(nx):
                if mask[iz, iy, ix]:
                    row[6 + ix // fx] += share


def _coarsen(grain: Grain, working_side: int) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Return the share of each (block of) voxel(s) that is inside, padded, and the block (z, y, x)."""
    mask = np.asarray(grain.mask)
    if mask.ndim != 3 or mask.dtype.kind not in "bui":
        raise FitError(
            f"The mask of grain '{grain.name}' has {mask.ndim} axes of {mask.dtype}: it must be booleans "
            "along three axes; Grain.from_mask checks it."
        )
    if not mask.any():
        raise FitError(f"Grain '{grain.name}' has no voxels: nothing can be fitted to it.")
    edges = np.array(grain.voxel_size.zyx)
    longest = float((np.array(mask.shape) * edges).max())
    target = longest / working_side
    blocks = [max(1, math.ceil(target / edge - 1e-9)) for edge in edges]
    shape = tuple(-(-side // block) + 2 * PAD for side, block in zip(mask.shape, blocks, strict=True))
    share = np.zeros(shape, dtype=np.float32)
    _block_average(np.ascontiguousarray(mask, dtype=np.bool_), blocks[0], blocks[1], blocks[2], share)
    return share, (blocks[0], blocks[1], blocks[2])


def _fill_cavities(
    grain: Grain, share: Float32[np.ndarray, "nz ny nx"], cavities: Cavities
) -> tuple[Bool[np.ndarray, "nz ny nx"], int, int]:
    """Return the solid of a grain's shares, voxels of cavities filled, and cavities kept; `share` follows."""
    import cc3d
    import fill_voids

    pieces = int(cc3d.connected_components(share > 0, connectivity=26).max())
    if pieces > 1:
        raise FitError(
            f"Grain '{grain.name}' falls into {pieces} separate pieces: fit each by itself, or make the "
            "grain with Grain.from_mask(..., keep='largest')."
        )
    mask = share >= 0.5
    if not mask.any():
        # A plate thinner than half a block: all that it touches, or there would be no surface.
        mask = share > 0
        share[mask] = 1.0
    solid, filled = fill_voids.fill(mask, in_place=False, return_fill_count=True)
    if cavities == "keep":
        return mask, 0, int(cc3d.connected_components(solid & ~mask, connectivity=6).max())
    if filled:
        share[solid & (share < 0.5)] = 1.0
    return solid, int(filled), 0


def _signed_distance(
    mask: Bool[np.ndarray, "nz ny nx"], spacing: Float64[np.ndarray, "3"], voxel: float
) -> Float32[np.ndarray, "nz ny nx"]:
    """Return the distance to the surface, positive inside; `spacing` is (x, y, z)."""
    import edt

    # Inside and outside as two labels: one transform gives the distance to the other side for both.
    distance = edt.edt(mask.view(np.uint8) + np.uint8(1), anisotropy=tuple(spacing[::-1]), parallel=1)
    distance -= np.float32(0.5 * voxel)
    np.negative(distance, out=distance, where=~mask)
    return np.asarray(distance)


class _Hull(NamedTuple):
    """Points on the surface, its tips with their shares, and its area; NaN where voxels are few or long."""

    points: Float64[np.ndarray, "m 3"]
    tips: Float64[np.ndarray, "t 3"]
    tip_shares: Float64[np.ndarray, "t"]
    area: float
    sharpened: bool


def _find_hull(
    mask: Bool[np.ndarray, "nz ny nx"],
    share: Float32[np.ndarray, "nz ny nx"],
    spacing: Float64[np.ndarray, "3"],
    averaged: bool,
    hull: Literal["surface", "voxels"],
    most: int,
    rng: np.random.Generator,
) -> _Hull:
    """Return the hull of a solid; `averaged` tells whether its voxels are means of blocks."""
    if averaged:
        smoothing = _SMOOTHING_OF_BLOCKS
    else:
        count = int(np.count_nonzero(mask))
        smoothing = 1.0 if nominal_diameters(count) >= _SMALL_DIAMETER else _SMOOTHING_OF_FEW
    # Few or long voxels have steps that a sharper surface would follow.
    sharpened = bool(smoothing != _SMOOTHING_OF_FEW and spacing.max() < _LONG_VOXELS * spacing.min())
    if hull == "voxels":
        points = outermost_voxels(mask, spacing, most, rng)
        return _Hull(points, points[:0], np.empty(0), float("nan"), sharpened)
    points, corners, area = points_on_surface(share, spacing, smoothing, sharpened, most, rng)
    tips, tip_shares = tips_of(corners) if sharpened else (points[:0], np.empty(0))
    return _Hull(points, tips, tip_shares, area, sharpened)


def _choose_interior(
    distance: Float32[np.ndarray, "nz ny nx"], voxel: float, rng: np.random.Generator
) -> Int64[np.ndarray, " q"]:
    """Return flat indices of voxels well inside, as many as the search watches."""
    depth = max(2 * voxel, 0.06 * float(distance.max()))
    deep = np.flatnonzero(distance.ravel() > depth)
    if len(deep) > _MOST_INTERIOR:
        deep = rng.choice(deep, _MOST_INTERIOR, replace=False, shuffle=False)
    return deep


def prepare(
    grain: Grain,
    seed: int = 0,
    *,
    working_side: int = 120,
    hull_points: int = 24_000,
    hull: Literal["surface", "voxels"] = "surface",
    cavities: Cavities = "fill",
) -> PreparedGrain:
    """Crop, pad, coarsen and centre a grain; find its signed distance and hull points.

    Parameters
    ----------
    grain : Grain
    seed : int
        Of the places of the hull points and interior points.
    working_side : int
        Longest side of the working grid in voxels; larger grains are averaged in blocks, which
        keeps the share of each block and so the place of the surface.
    hull_points : int
        Points on the surface at most.
    hull : {'surface', 'voxels'}
        Points spread evenly over the smoothed surface, or the centres of the outermost voxels.
    cavities : {'fill', 'keep'}
        Whether enclosed cavities become solid, or stay empty with a surface of their own.

    Raises
    ------
    FitError
        If the grain has no voxels or several pieces, or its mask is not 3-D or not of whole numbers.
    """
    rng = np.random.default_rng([seed, 0])
    share, blocks = _coarsen(grain, working_side)
    spacing = (np.array(grain.voxel_size.zyx) * blocks)[::-1].copy()
    mask, filled, kept = _fill_cavities(grain, share, cavities)
    voxel = float(np.cbrt(spacing.prod()))
    distance = _signed_distance(mask, spacing, voxel)
    found = _find_hull(mask, share, spacing, max(blocks) > 1, hull, hull_points, rng)
    deep = _choose_interior(distance, voxel, rng)

    middle = found.points.mean(axis=0)
    scale = float(np.sqrt(((found.points - middle) ** 2).sum(axis=1).mean()))
    if scale <= 0:  # a single voxel is its own hull
        scale = 0.5 * voxel
    where = np.stack(np.unravel_index(deep, mask.shape), axis=1)[:, ::-1] * spacing
    first = np.asarray(grain.origin) + (np.array(blocks[::-1]) - 1) / 2 * grain.voxel_size.xyz - PAD * spacing
    volume = (grain.voxel_count + filled * int(np.prod(blocks))) * grain.voxel_size.volume
    return PreparedGrain(
        grain=grain, mask=mask, distance=distance / np.float32(scale), origin=-middle / scale,
        spacing=spacing / scale, voxel=voxel / scale,
        fineness=voxel * max(0.5, float(np.cbrt(1 / np.prod(blocks)))) / scale,
        hull=(found.points - middle) / scale, tips=(found.tips - middle) / scale,
        tip_shares=found.tip_shares, interior=(where - middle) / scale,
        interior_depth=distance.ravel()[deep].astype(np.float64) / scale,
        volume=volume / scale**3, area=found.area / scale**2 if found.sharpened else float("nan"),
        thickness=2 * volume / found.area / scale, center=first + middle, scale=scale, filled=filled,
        cavities=kept,
    )  # fmt: skip
