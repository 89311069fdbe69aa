"""A packing at rest, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.errors import PackingError
from mbstudio.core.fabric import anisotropy, fabric_tensor, rose
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.contacts import Contacts, find_contacts
from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.poses import Poses
from mbstudio.core.packing.solids import SolidGrid, count_solids

if TYPE_CHECKING:
    import pandas as pd
    import trimesh

INSET = 1.0
"""How far from walls, floor and surface measures begin, in mean nominal diameters of the grains."""
_POINTS_PER_DIAMETER = 20
_LEAST = 1.0


@dataclass(frozen=True)
class Core:
    """The inner part of a packing, where walls, floor and surface are not felt much.

    Attributes
    ----------
    margin : float
        Least distance from the side walls.
    low, high : float
        Heights.
    """

    margin: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Measures:
    """What is measured in the inner part of a packing.

    Attributes
    ----------
    porosity : float
        Share of void, counted on the avatars.
    coordination : float
        Mean number of other grains that a grain touches, those on its own included.
    neighbours : int array, shape (inside,)
        The same of each grain whose centre of mass lies in the inner part.
    fabric : float array, shape (3, 3)
        Mean of n n' over the normals of contacts in the inner part.
    anisotropy : float
        Of the fabric: 0 where all directions are alike.
    contacts : int
        How many contacts those are.
    counted_twice : float
        Share of the solid that two avatars hold: they stand out of their clumps here and there.
    core : Core
    """

    porosity: float
    coordination: float
    neighbours: Int[np.ndarray, " inside"]
    fabric: Float[np.ndarray, "3 3"]
    anisotropy: float
    contacts: int
    counted_twice: float
    core: Core


@dataclass(frozen=True, eq=False)
class Packing:
    """Grains that lie in a mould; lengths in `unit`.

    Attributes
    ----------
    kinds : GrainKinds
        Avatars and clumps.
    poses : Poses
    mould : Mould
    friction : float
        Between grains; NaN if it is not known.
    history : mapping
        How the packing came about: engine, seed, steps, seconds, kinetic energy at rest.
    touching : Contacts or None
        Contacts with the forces that an engine told; by default they are found without.
    gap : float
        How far apart spheres may be and count as touching.
    """

    kinds: GrainKinds
    poses: Poses
    mould: Mould
    friction: float = float("nan")
    history: dict[str, Any] = field(default_factory=dict)
    touching: Contacts | None = None
    gap: float = 0.0

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def unit(self) -> str:
        """Of all lengths."""
        return self.kinds.unit

    @property
    def diameters(self) -> Float[np.ndarray, " count"]:
        """Nominal diameters of the grains."""
        diameters: np.ndarray = self.kinds.diameters[self.poses.kinds] * self.poses.scales
        return diameters

    @property
    def mean_diameter(self) -> float:
        """Mean nominal diameter of the grains."""
        return float(self.diameters.mean())

    @cached_property
    def found_contacts(self) -> Contacts:
        """All contacts, with the forces that the engine told."""
        if self.touching is not None:
            return self.touching
        return find_contacts(self.kinds, self.poses, self.mould, self.gap)

    @cached_property
    def solids(self) -> SolidGrid:
        """Points over the mould with the number of grains that hold each, twenty to a mean diameter."""
        return count_solids(self.kinds, self.poses, self.mould, self.mean_diameter / _POINTS_PER_DIAMETER)

    def core(self, inset: float = INSET) -> Core:
        """Return the part of the packing that lies so many mean diameters within it.

        Raises
        ------
        PackingError
            If nothing is left, or less than a diameter.
        """
        margin = inset * self.mean_diameter
        columns = self._columns(margin)
        wide = np.inf if self.mould.periodic else 2 * (self.mould.half - margin)
        # The median: columns that see through to the floor say nothing about the surface.
        surface = float(np.median(self.solids.surface_heights()[columns])) if columns.any() else 0.0
        low, high = margin, surface - margin
        if min(wide, high - low) < _LEAST * self.mean_diameter:
            raise PackingError(
                f"The packing of {len(self)} grains has no inner part: {inset:g} diameters from walls, floor "
                f"and surface leave {max(min(wide, high - low), 0.0) / self.mean_diameter:.1f} diameters. "
                "Pack more grains, or measure with a smaller inset."
            )
        return Core(margin, low, high)

    def measures(self, inset: float = INSET) -> Measures:
        """Measure the inner part.

        Parameters
        ----------
        inset : float
            Distance from walls, floor and surface, in mean nominal diameters.

        Raises
        ------
        PackingError
            If nothing is left inside.
        """
        core = self.core(inset)
        columns = self._columns(core.margin)
        contacts = self.found_contacts
        mine = contacts.among_grains & self._within(contacts.points, core)
        inside = self._within(self.poses.positions, core)
        if not inside.any():
            raise PackingError("No grain has its centre in the inner part: pack more grains.")
        neighbours = contacts.neighbours(len(self))[inside]
        fabric = fabric_tensor(contacts.normals[mine])
        return Measures(
            self.solids.porosity(columns, core.low, core.high),
            float(neighbours.mean()),
            neighbours,
            fabric,
            float(anisotropy(fabric)),
            int(mine.sum()),
            self.solids.counted_twice(columns, core.low, core.high),
            core,
        )

    @cached_property
    def _usual(self) -> Measures:
        return self.measures()

    @property
    def porosity(self) -> float:
        """Share of void in the inner part, one mean diameter from walls, floor and surface."""
        return self._usual.porosity

    @property
    def coordination(self) -> float:
        """Mean number of other grains that a grain of the inner part touches."""
        return self._usual.coordination

    @property
    def fabric(self) -> Float[np.ndarray, "3 3"]:
        """Mean of n n' over the normals of the contacts in the inner part."""
        return self._usual.fabric

    @property
    def overlap(self) -> float:
        """The largest overlap of two clumps, or of a clump and the mould, over the mean diameter."""
        overlaps = self.found_contacts.overlaps
        return float(overlaps.max() / self.mean_diameter) if len(overlaps) else 0.0

    @property
    def contacts(self) -> pd.DataFrame:
        """A row for each contact: grains (-1 floor, -2 side wall), point, normal, overlap, force."""
        import pandas as pd

        found = self.found_contacts
        return pd.DataFrame(
            {
                "grain": found.pairs[:, 0],
                "other": found.pairs[:, 1],
                **dict(zip(("x", "y", "z"), found.points.T, strict=True)),
                **dict(zip(("nx", "ny", "nz"), found.normals.T, strict=True)),
                "overlap": found.overlaps,
                "force": found.forces,
            }
        )

    def rose(self, inset: float = INSET, bins: int = 18) -> Float[np.ndarray, " bins"]:
        """Return how often contact normals of the inner part point 0 to 90 degrees up, over chance."""
        contacts = self.found_contacts
        mine = contacts.among_grains & self._within(contacts.points, self.core(inset))
        return rose(contacts.normals[mine], bins)

    def profile(self, inset: float = INSET) -> pd.DataFrame:
        """Return the porosity of each layer of points, away from the side walls; heights in `unit`."""
        import pandas as pd

        shares = self.solids.porosity_by_height(self._columns(inset * self.mean_diameter))
        return pd.DataFrame({"height": self.solids.heights, "porosity": shares})

    def wall_profile(self, inset: float = INSET) -> pd.DataFrame:
        """Return the porosity by the distance from the side walls, in `unit`."""
        import pandas as pd

        core = self.core(inset)
        away, shares = self.solids.porosity_by_wall_distance(core.low, core.high, self.mean_diameter / 10)
        return pd.DataFrame({"distance": away, "porosity": shares})

    def avatar(self, grain: int) -> Avatar:
        """Return one grain's avatar where it lies."""
        local = self.kinds.avatars[self.poses.kinds[grain]].scaled(float(self.poses.scales[grain]))
        turned: Avatar = local.transformed(self.poses.rotations[grain], self.poses.positions[grain])
        return turned

    def mesh(self, cells: int = 32) -> trimesh.Trimesh:
        """Return all surfaces in one mesh, in `unit`; the face attribute `grain` tells them apart.

        Parameters
        ----------
        cells : int
            Along the longest side of each grain.
        """
        import trimesh

        forms = [avatar.mesh(cells) for avatar in self.kinds.avatars]
        vertices, faces, owners, start = [], [], [], 0
        for grain, (kind, scale, place, turn) in enumerate(
            zip(self.poses.kinds, self.poses.scales, self.poses.positions, self.poses.rotations, strict=True)
        ):
            form = forms[kind]
            vertices.append(scale * np.asarray(form.vertices) @ turn.T + place)
            faces.append(np.asarray(form.faces) + start)
            owners.append(np.full(len(form.faces), grain))
            start += len(form.vertices)
        mesh = trimesh.Trimesh(
            np.concatenate(vertices),
            np.concatenate(faces),
            process=False,
            face_attributes={"grain": np.concatenate(owners)},
        )
        mesh.units = self.unit
        return mesh

    def summary(self, inset: float = INSET) -> dict[str, Any]:
        """Return the measures as plain values: lengths in `unit`, overlap over the mean diameter."""
        found = self.measures(inset)
        return {
            "grains": len(self),
            "grains_inside": len(found.neighbours),
            "mean_diameter": self.mean_diameter,
            "unit": self.unit,
            "mould": self.mould.shape,
            "width": 2 * self.mould.half,
            "height": float(found.core.high + found.core.margin),
            "friction": self.friction,
            "porosity": found.porosity,
            "void_ratio": found.porosity / (1 - found.porosity),
            "coordination": found.coordination,
            "anisotropy": found.anisotropy,
            "fabric": found.fabric.tolist(),
            "overlap": self.overlap,
            "counted_twice": found.counted_twice,
            **self.history,
        }

    def _columns(self, margin: float) -> Bool[np.ndarray, "y x"]:
        columns: np.ndarray = self.solids.wall_distances > margin
        return columns

    def _within(self, points: Float[np.ndarray, "m 3"], core: Core) -> Bool[np.ndarray, " m"]:
        walls = self.mould.wall_distance(points[:, :2]) > core.margin
        within: np.ndarray = walls & (points[:, 2] > core.low) & (points[:, 2] < core.high)
        return within
