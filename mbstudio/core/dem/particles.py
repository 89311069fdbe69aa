"""The particles of a specimen, as targets and their decks take them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.populations.sieving import SizeDistribution


@dataclass(frozen=True, eq=False)
class Specimen:
    """Particles in a box that stands around the z axis on the plane z = 0.

    Attributes
    ----------
    names : tuple of str
        Of the avatars, as the export's files are called.
    kinds : int array, shape (count,)
        Which avatar each particle is.
    scales : float array, shape (count,)
        Its size over the avatar's.
    sizes : float array, shape (count,)
        Intermediate axes, in unit.
    positions : float array, shape (count, 3)
        Centres of mass, in unit.
    quaternions : float array, shape (count, 4)
        Orientations (w, x, y, z) of the principal axes.
    half, top : float
        Half the width and the height of the box, in unit.
    volumes : float array, shape (kinds,)
        Of the avatars, in unit**3.
    reaches : float array, shape (kinds,)
        Radii of the avatars' bounding spheres about the centre of mass, in unit.
    unit : str
    periodic : bool
        Whether the sides of the box are periodic.
    """

    names: tuple[str, ...]
    kinds: Int[np.ndarray, " count"]
    scales: Float[np.ndarray, " count"]
    sizes: Float[np.ndarray, " count"]
    positions: Float[np.ndarray, "count 3"]
    quaternions: Float[np.ndarray, "count 4"]
    half: float
    top: float
    volumes: Float[np.ndarray, " kinds"]
    reaches: Float[np.ndarray, " kinds"]
    unit: str
    periodic: bool = False

    def curve(self) -> SizeDistribution:
        """Return percent finer by mass at every particle's size, as a sieve analysis would find it."""
        order = np.argsort(self.sizes, kind="stable")
        mass = np.cumsum((self.volumes[self.kinds] * self.scales**3)[order])
        return SizeDistribution(self.sizes[order], 100.0 * mass / mass[-1], self.unit)
