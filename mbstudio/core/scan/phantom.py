"""A synthetic scan with true labels: mbstudio's sample, and the truth that segmentation is scored on.

Grains of several kinds are packed into contact, one after another, where a correlation of the
grain with the packing so far finds the place that touches most without overlapping. Voxels get
the share of them that the grains fill, then blur, noise and a cylindrical field of view.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy import fft, ndimage

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.phantom_grains import PhantomGrain, make_grain
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

# The packing goes on beyond the box by this many voxels, so that the scan cuts grains off.
_MARGIN = 16
# Grains are placed on a grid of this many voxels before they are drawn finely.
_COARSE = 3
_SUBSAMPLES = 2
# Shares of the work that placing and drawing the grains take.
_PACKED, _DRAWN = 0.42, 0.56
# Pieces of grains that the field of view cuts off below this many voxels are left out.
_SMALLEST_PIECE = 60

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class KindOfGrain:
    """Share by number and range of diameters (voxels) of one kind."""

    share: float
    diameter: tuple[float, float]


@dataclass(frozen=True)
class PhantomRecipe:
    """What a synthetic scan is made of; lengths in voxels.

    Attributes
    ----------
    shape : tuple of int
        (Z, Y, X).
    voxel_size : VoxelSize
    kinds : mapping of str to KindOfGrain
    field_of_view_radius : float or None
        Radius of the cylinder along z; None for a full box.
    blur : float
        Standard deviation of the point spread.
    noise : float
        Standard deviation of the noise in a grain, relative to its grey value; it goes with the
        root of the grey value, as counting noise does.
    contact_overlap : float
        Number of voxels that a grain may share with those placed before it.
    void, grain, grain_spread, inclusion : float
        Grey values.
    inclusions : int
        Number of bright inclusions inside grains, of `inclusion_diameter`.
    bright_grains : int
        Number of grains that are bright as a whole.
    """

    shape: tuple[int, int, int]
    voxel_size: VoxelSize
    kinds: Mapping[str, KindOfGrain] = field(default_factory=lambda: MappingProxyType({}))
    field_of_view_radius: float | None = None
    blur: float = 0.7
    noise: float = 0.035
    contact_overlap: float = 24
    void: float = 17000
    grain: float = 34000
    grain_spread: float = 1200
    inclusion: float = 54000
    inclusions: int = 0
    inclusion_diameter: tuple[float, float] = (4.0, 8.0)
    bright_grains: int = 0

    @classmethod
    def read(cls, path: str | Path) -> PhantomRecipe:
        """Read a recipe from a TOML file; ScanError if it is none."""
        try:
            with Path(path).open("rb") as stream:
                content = tomllib.load(stream)
            return cls._from_content(content)
        except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
            raise ScanError(
                f"{path} is not a recipe of a synthetic scan ({error}): "
                "compare it with assets/sample_scan.toml."
            ) from error

    @classmethod
    def _from_content(cls, content: Mapping[str, Any]) -> PhantomRecipe:
        grey, inclusions = content.get("grey", {}), content.get("inclusions", {})
        plain = {
            key: content[key]
            for key in ("field_of_view_radius", "blur", "noise", "contact_overlap")
            if key in content
        }
        low, high = inclusions.get("diameter", (4.0, 8.0))
        return cls(
            shape=tuple(int(count) for count in content["shape"]),  # type: ignore[arg-type]
            voxel_size=VoxelSize.parse(content["voxel_size"]),
            kinds=MappingProxyType(
                {
                    name: KindOfGrain(kind["share"], tuple(kind["diameter"]))
                    for name, kind in content["kinds"].items()
                }
            ),
            inclusions=inclusions.get("count", 0),
            inclusion_diameter=(low, high),
            bright_grains=inclusions.get("whole_grains", 0),
            **plain,
            **grey,
        )


@dataclass(frozen=True, eq=False)
class Phantom:
    """A synthetic scan and the truth behind it.

    Attributes
    ----------
    scan : Scan
        uint16 grey values.
    labels : int32 array, shape (Z, Y, X)
        The true grains 1..N, 0 outside them; a voxel belongs to the grain that fills at least
        half of it.
    kinds : tuple of str
        Kind of grain 1..N.
    """

    scan: Scan
    labels: Int[np.ndarray, "Z Y X"]
    kinds: tuple[str, ...]


def sample_recipe() -> PhantomRecipe:
    """Return the recipe of the built-in sample scan."""
    from mbstudio.core.assets import asset

    return PhantomRecipe.read(asset("sample_scan.toml"))


def sample_scan(progress: Progress | None = None) -> Phantom:
    """Make the built-in sample scan; the same at every call."""
    return make_phantom(sample_recipe(), seed=0, progress=progress)


def make_phantom(recipe: PhantomRecipe, seed: int = 0, progress: Progress | None = None) -> Phantom:
    """Make a synthetic scan, deterministic by seed.

    Parameters
    ----------
    recipe : PhantomRecipe
    seed : int
    progress : callable, optional
        ``progress(share, message)`` at each grain; what it raises ends the work at once.

    Raises
    ------
    ScanError
        If the recipe names no kinds of grains, or its box is too small for one grain.
    """
    if not recipe.kinds:
        raise ScanError(
            "The recipe has no kinds of grains: add at least one [kinds.<name>] with share and diameter."
        )
    rng = np.random.default_rng(seed)
    told = progress or (lambda share, message: None)
    placed = _pack(recipe, rng, told)
    labels, fill, grey, kinds = _draw(recipe, placed, rng, told)
    told(_PACKED + _DRAWN, "Blur and noise")
    if not kinds:
        raise ScanError(
            f"No grain fits into the recipe's box {recipe.shape}: make it larger or the grains smaller."
        )
    image = recipe.void + fill * (grey - recipe.void)
    image = ndimage.gaussian_filter(image.astype(np.float32), recipe.blur, mode="nearest")
    deviation = recipe.noise * np.sqrt(np.maximum(image, 0) * recipe.grain)
    image += deviation * rng.standard_normal(image.shape, dtype=np.float32)
    image = np.clip(np.rint(image), 1, np.iinfo(np.uint16).max).astype(np.uint16)
    image[~_field_of_view(recipe)] = 0
    image.flags.writeable = labels.flags.writeable = False
    return Phantom(Scan(image, recipe.voxel_size), labels, kinds)


def _field_of_view(recipe: PhantomRecipe) -> np.ndarray:
    """Return the cylinder along z as a mask of the scan's shape."""
    _, ny, nx = recipe.shape
    if recipe.field_of_view_radius is None:
        return np.ones(recipe.shape, dtype=bool)
    y, x = np.ogrid[:ny, :nx]
    disk = (y - (ny - 1) / 2) ** 2 + (x - (nx - 1) / 2) ** 2 <= recipe.field_of_view_radius**2
    return np.broadcast_to(disk, recipe.shape)


def _pack(
    recipe: PhantomRecipe, rng: np.random.Generator, progress: Progress
) -> list[tuple[PhantomGrain, np.ndarray]]:
    """Place grains until no more fit; return them with their centres (z, y, x) in voxels."""
    names = list(recipe.kinds)
    shares = np.array([recipe.kinds[name].share for name in names], dtype=float)
    shares /= shares.sum()
    padded = np.array(recipe.shape) + 2 * _MARGIN
    coarse = tuple(int(count) for count in -(-padded // _COARSE))
    transform_shape = tuple(fft.next_fast_len(count, real=True) for count in coarse)
    occupied = np.zeros(coarse, dtype=bool)
    placed: list[tuple[PhantomGrain, np.ndarray]] = []
    to_fill = 0.66 * occupied.size
    volume_left = to_fill
    failures = 0
    while failures < 4 and volume_left > 0:
        progress(_PACKED * (1 - volume_left / to_fill), f"{len(placed)} grains placed")
        name = names[rng.choice(len(names), p=shares)]
        low, high = recipe.kinds[name].diameter
        grain = make_grain(name, float(rng.uniform(low, high)), rng)
        stamp = _coarse_mask(grain)
        corner = _best_place(occupied, stamp, transform_shape, recipe.contact_overlap / _COARSE**3, rng)
        if corner is None:
            failures += 1
            continue
        failures = 0
        window = tuple(
            slice(start, start + length) for start, length in zip(corner, stamp.shape, strict=True)
        )
        occupied[window] |= stamp
        volume_left -= int(stamp.sum())
        centre = (np.array(corner) + (np.array(stamp.shape) - 1) / 2) * _COARSE + (_COARSE - 1) / 2 - _MARGIN
        reach = (stamp.shape[0] // 2 + 1) * _COARSE
        placed.append((replace(grain, reach=float(reach)), centre))
    return placed


def _coarse_mask(grain: PhantomGrain) -> np.ndarray:
    """Return the grain on the placing grid, centred in an odd box."""
    half = int(np.ceil(grain.reach / _COARSE))
    axis = np.arange(-half, half + 1) * float(_COARSE)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = grain.body(np.column_stack([x.ravel(), y.ravel(), z.ravel()])) < 0
    mask = inside.reshape(x.shape)
    # Crop evenly on both sides, so that the grain's origin stays the box's middle.
    reach = int(np.abs(np.argwhere(mask) - half).max())
    window = slice(half - reach, half + reach + 1)
    return mask[window, window, window]


def _best_place(
    occupied: np.ndarray,
    stamp: np.ndarray,
    transform_shape: tuple[int, ...],
    overlap: float,
    rng: np.random.Generator,
) -> tuple[int, int, int] | None:
    """Return the corner where the grain touches most within the allowed overlap, None if there is none."""
    free = tuple(slice(0, whole - part + 1) for whole, part in zip(occupied.shape, stamp.shape, strict=True))
    if not occupied.any():
        middle = [(whole - part) // 2 for whole, part in zip(occupied.shape, stamp.shape, strict=True)]
        return middle[0], middle[1], middle[2]
    # One correlation counts both: shared voxels in units far above the most that can be touched.
    touched = ndimage.binary_dilation(occupied) & ~occupied
    far_above = float(2 ** int(stamp.sum()).bit_length())
    weights = occupied * far_above - touched
    spectrum = fft.rfftn(weights, transform_shape) * np.conj(fft.rfftn(stamp.astype(float), transform_shape))
    cost = np.rint(fft.irfftn(spectrum, transform_shape)[free])
    shared = np.ceil(cost / far_above)
    touching = shared * far_above - cost
    score = np.where(shared <= overlap, touching - 2 * shared, -np.inf)
    best = float(score.max())
    if best == -np.inf:
        return None
    candidates = np.flatnonzero(score == best)
    chosen = int(candidates[rng.integers(len(candidates))])
    z, y, x = np.unravel_index(chosen, score.shape)
    return int(z), int(y), int(x)


def _draw(
    recipe: PhantomRecipe,
    placed: list[tuple[PhantomGrain, np.ndarray]],
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Draw the grains: true labels, filled share of each voxel, grey value of what fills it."""
    shape = recipe.shape
    nearest = np.full(shape, np.inf, dtype=np.float32)
    fill = np.zeros(shape, dtype=np.float32)
    grey = np.full(shape, recipe.grain, dtype=np.float32)
    owner = np.zeros(shape, dtype=np.int32)
    tones = recipe.grain + recipe.grain_spread * rng.standard_normal(len(placed))
    tones[rng.permutation(len(placed))[: recipe.bright_grains]] = recipe.inclusion
    for number, ((grain, centre), tone) in enumerate(zip(placed, tones, strict=True), start=1):
        progress(_PACKED + _DRAWN * (number - 1) / len(placed), f"{number} of {len(placed)} grains drawn")
        box = _box(centre, grain.reach, shape)
        if box is None:
            continue
        distance, share = _distance_and_share(grain, centre, box)
        closer = distance < nearest[box]
        nearest[box][closer] = distance[closer]
        owner[box][closer & (distance < 0)] = number
        fill[box] = np.minimum(1.0, fill[box] + share)
        grey[box][closer] = tone
    _add_inclusions(recipe, owner, grey, rng)
    owner[(fill < 0.5) | ~_field_of_view(recipe)] = 0
    labels, kept = _numbered(owner)
    return labels, fill, grey, tuple(placed[number - 1][0].kind for number in kept)


def _box(centre: np.ndarray, reach: float, shape: tuple[int, int, int]) -> tuple[slice, slice, slice] | None:
    """Return the part of the volume that the grain can reach."""
    low = np.maximum(np.floor(centre - reach - 1).astype(int), 0)
    high = np.minimum(np.ceil(centre + reach + 2).astype(int), shape)
    if (low >= high).any():
        return None
    return slice(low[0], high[0]), slice(low[1], high[1]), slice(low[2], high[2])


def _distance_and_share(
    grain: PhantomGrain, centre: np.ndarray, box: tuple[slice, slice, slice]
) -> tuple[Float[np.ndarray, "z y x"], Float[np.ndarray, "z y x"]]:
    """Return each voxel's distance and, by subsamples at the surface, its filled share."""
    axes = [np.arange(part.start, part.stop) - middle for part, middle in zip(box, centre, strict=True)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    distance = grain.body(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(x.shape)
    share = (distance < 0).astype(np.float32)
    edge = np.abs(distance) < 1.5
    middles = np.column_stack([x[edge], y[edge], z[edge]])
    steps = (np.arange(_SUBSAMPLES) + 0.5) / _SUBSAMPLES - 0.5
    offsets = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    values = grain.body((middles[:, None] + offsets).reshape(-1, 3)).reshape(len(middles), len(offsets))
    share[edge] = np.clip(0.5 - values * _SUBSAMPLES, 0, 1).mean(axis=1)
    return distance.astype(np.float32), share


def _add_inclusions(
    recipe: PhantomRecipe, owner: np.ndarray, grey: np.ndarray, rng: np.random.Generator
) -> None:
    """Make balls inside grains bright."""
    inside = np.argwhere(owner > 0)
    if not len(inside):
        return
    for middle in inside[rng.choice(len(inside), size=recipe.inclusions)]:
        radius = rng.uniform(*recipe.inclusion_diameter) / 2
        box = _box(middle.astype(float), radius, recipe.shape)
        if box is None:
            continue
        z, y, x = np.ogrid[box]
        ball = (z - middle[0]) ** 2 + (y - middle[1]) ** 2 + (x - middle[2]) ** 2 <= radius**2
        grey[box][ball & (owner[box] == owner[tuple(middle)])] = recipe.inclusion


def _numbered(owner: np.ndarray) -> tuple[Int[np.ndarray, "Z Y X"], list[int]]:
    """Keep the largest piece of each grain and number the grains 1..N; return the kept numbers."""
    labels = np.zeros(owner.shape, dtype=np.int32)
    kept: list[int] = []
    for number, box in enumerate(ndimage.find_objects(owner), start=1):
        if box is None:
            continue
        pieces, count = ndimage.label(owner[box] == number, structure=np.ones((3, 3, 3)))
        sizes = np.bincount(pieces.ravel())[1:]
        if not count or sizes.max() < _SMALLEST_PIECE:
            continue
        kept.append(number)
        labels[box][pieces == 1 + int(sizes.argmax())] = len(kept)
    return labels, kept
