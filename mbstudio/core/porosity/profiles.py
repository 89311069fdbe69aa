"""Porosity of a segmented specimen, as a whole and along its axes and its radius."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain_set import GrainSet

_SLICES = 16
_FEWEST_RINGS = 4
_RINGS = 24


@dataclass(frozen=True, eq=False)
class Specimen:
    """Part of the scan that counts as specimen: a prism along one axis of the array.

    Attributes
    ----------
    axis : int
        Of the array [z, y, x], along which it runs.
    footprint : bool array
        Its cross-section over the two other axes.
    bounds : tuple of int
        First slice along the axis, and the one after the last.
    words : str
        What it is, in a sentence.
    """

    axis: int
    footprint: Bool[np.ndarray, "a b"]
    bounds: tuple[int, int]
    words: str

    @classmethod
    def of_scan(cls, grains: GrainSet) -> Specimen:
        """Return all that the scan has seen."""
        shape = grains.label_volume.shape
        view = grains.view
        if view is None or view.footprint.all():
            return cls(0, np.ones(shape[1:], dtype=bool), (0, shape[0]), "the whole scan")
        return cls(
            view.axis, np.asarray(view.footprint, dtype=bool), (0, shape[view.axis]),
            "the field of view that the scan has seen",
        )  # fmt: skip

    @classmethod
    def cylinder(
        cls,
        grains: GrainSet,
        diameter: float,
        centre: tuple[float, float] | None = None,
        height: tuple[float, float] | None = None,
    ) -> Specimen:
        """Return a cylinder along z, such as the specimen without the wall of its mould.

        Parameters
        ----------
        grains : GrainSet
        diameter : float
            In the unit of the grains.
        centre : tuple of float, optional
            (x, y) of its axis, as grains have their places; the middle of the scan by default.
        height : tuple of float, optional
            From and to, along z: slices whose middle lies between; all by default.

        Raises
        ------
        MeasureError
            If it does not lie within the scan.
        """
        nz, ny, nx = grains.label_volume.shape
        size, origin = grains.voxel_size, grains.origin
        x = origin[0] + size.x * np.arange(nx)
        y = origin[1] + size.y * np.arange(ny)
        cx, cy = centre if centre is not None else (float(x.mean()), float(y.mean()))
        radius = diameter / 2
        inside = (
            cx - radius >= x[0] - size.x / 2 - 1e-9 * radius
            and cx + radius <= x[-1] + size.x / 2 + 1e-9 * radius
            and cy - radius >= y[0] - size.y / 2 - 1e-9 * radius
            and cy + radius <= y[-1] + size.y / 2 + 1e-9 * radius
        )
        if not (diameter > 0 and inside):
            raise MeasureError(
                f"A cylinder {diameter:g} {grains.unit} across about ({cx:g}, {cy:g}) does not lie within "
                f"the scan, which is {nx * size.x:g} by {ny * size.y:g} {grains.unit} wide."
            )
        low, high = 0, nz
        if height is not None:
            bottom, top = ((edge - origin[2]) / size.z for edge in height)
            low, high = int(np.ceil(bottom - 1e-9)), int(np.floor(top + 1e-9)) + 1
            if not 0 <= low < high <= nz:
                raise MeasureError(
                    f"Heights of {height[0]:g} to {height[1]:g} {grains.unit} do not lie within the scan."
                )
        footprint = (x[None] - cx) ** 2 + (y[:, None] - cy) ** 2 <= radius**2
        return cls(0, footprint, (low, high), f"a cylinder {diameter:g} {grains.unit} across")


@dataclass(frozen=True, eq=False)
class PorosityProfile:
    """Porosity along one direction.

    Attributes
    ----------
    along : str
        'x', 'y', 'z' or 'radius'.
    places : float array, shape (places,)
        In `unit`: of slices as in the scan, of rings the distance of their middle from the axis.
    porosity : float array, shape (places,)
        Share of pores, 0 to 1; one less of it is the solid fraction.
    voxels : int array, shape (places,)
        That each was counted on.
    unit : str
    """

    along: str
    places: Float[np.ndarray, " places"]
    porosity: Float[np.ndarray, " places"]
    voxels: Int[np.ndarray, " places"]
    unit: str

    @property
    def solid_fraction(self) -> Float[np.ndarray, " places"]:
        """Share of grains."""
        return 1.0 - self.porosity

    @property
    def mean(self) -> float:
        """Porosity of all together."""
        return float(self.porosity @ self.voxels / self.voxels.sum())


def porosity_profiles(grains: GrainSet, specimen: Specimen | None = None) -> dict[str, PorosityProfile]:
    """Return the porosity along z, y, x and, of round specimens, along the radius.

    Solid is what belongs to a grain, also to one that the border cuts or that was excluded; all else is pore,
    cavities of grains too. The void ratio is porosity / (1 - porosity).

    Parameters
    ----------
    grains : GrainSet
    specimen : Specimen, optional
        All that the scan has seen by default.

    Returns
    -------
    dict of str to PorosityProfile
        Each holds the porosity of the whole as its `mean`.

    Raises
    ------
    MeasureError
        If the grains are bodies of mesh files, or the specimen holds no voxel.
    """
    if grains.is_of_meshes:
        raise MeasureError("Bodies of mesh files have no pores between them: porosity needs a scan.")
    specimen = specimen or Specimen.of_scan(grains)
    counted, length = specimen.footprint, specimen.bounds[1] - specimen.bounds[0]
    if not counted.any() or length <= 0:
        raise MeasureError("The specimen holds no voxel: give a larger one.")
    solid = np.zeros(counted.shape, dtype=np.int64)
    slices = []
    for part in solid_slices(grains, specimen):
        solid += part.sum(axis=0)
        slices.append(np.count_nonzero(part[:, counted], axis=1))
    names = ["z", "y", "x"]
    along = names.pop(specimen.axis)
    edges, origin = grains.voxel_size.zyx, grains.origin[::-1]
    low, high = specimen.bounds
    axis = specimen.axis
    within = np.where(counted, solid, 0)
    found = {
        along: _profile(
            along, origin[axis] + edges[axis] * np.arange(low, high), np.concatenate(slices),
            np.full(length, np.count_nonzero(counted)), grains.unit,
        )
    }  # fmt: skip
    others = [place for place in range(3) if place != axis]
    for which, (name, place) in enumerate(zip(names, others, strict=True)):
        sums, voxels = within.sum(axis=1 - which), counted.sum(axis=1 - which) * length
        rows = np.flatnonzero(voxels)
        found[name] = _profile(
            name, origin[place] + edges[place] * rows, sums[rows], voxels[rows], grains.unit
        )
    if not counted.all():
        found["radius"] = _radial(within, counted, (edges[others[0]], edges[others[1]]), length, grains.unit)
    return found


def solid_slices(grains: GrainSet, specimen: Specimen) -> Iterator[Bool[np.ndarray, "n a b"]]:
    """Yield which voxels are grain, some slices across the specimen's axis at a time."""
    shape = grains.label_volume.shape
    low, high = specimen.bounds
    for start in range(low, high, _SLICES):
        box = [slice(0, size) for size in shape]
        box[specimen.axis] = slice(start, min(start + _SLICES, high))
        part = grains.label_volume.read((box[0], box[1], box[2])) > 0
        yield np.moveaxis(part, specimen.axis, 0)


def _radial(
    solid: Int[np.ndarray, "a b"],
    counted: Bool[np.ndarray, "a b"],
    edges: tuple[float, float],
    length: int,
    unit: str,
) -> PorosityProfile:
    """Return the porosity in rings of equal width about the middle of the cross-section."""
    rows, columns = np.nonzero(counted)
    y, x = edges[0] * (rows - rows.mean()), edges[1] * (columns - columns.mean())
    radii = np.hypot(x, y)
    width = max(float(radii.max()) / _RINGS, 2.0 * max(edges))
    rings = max(_FEWEST_RINGS, int(np.ceil(float(radii.max()) / width)))
    borders = np.linspace(0.0, float(radii.max()) * (1 + 1e-9), rings + 1)
    ring = np.searchsorted(borders, radii, side="right") - 1
    sums = np.bincount(ring, weights=solid[rows, columns], minlength=rings)
    voxels = np.bincount(ring, minlength=rings) * length
    there = np.flatnonzero(voxels)
    return _profile("radius", ((borders[:-1] + borders[1:]) / 2)[there], sums[there], voxels[there], unit)


def _profile(
    along: str, places: np.ndarray, solid: np.ndarray, voxels: np.ndarray, unit: str
) -> PorosityProfile:
    return PorosityProfile(along, places.astype(float), 1.0 - solid / voxels, voxels.astype(np.int64), unit)
