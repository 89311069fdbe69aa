"""The kinds of grains of a packing: avatars in their principal frames, and the clumps that touch for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.body import choose_names, prepare_bodies
from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.dem.shapes.many_clumps import fit_ahead
from mbstudio.core.errors import ExportError, PackingError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball.avatar import Avatar

Progress = Callable[[float, str], object]


@dataclass(frozen=True, eq=False)
class GrainKinds:
    """What a packing knows of the avatars that its grains are made of; lengths in `unit`.

    Attributes
    ----------
    names : tuple of str
    avatars : tuple of Avatar
        Centre of mass at the origin, principal axes along x, y, z, moments ascending.
    clumps : tuple of Clump
        In the same frames. An avatar of one control point is a sphere and has one sphere.
    volumes : float array, shape (kinds,)
        Of the avatars.
    gyrations : float array, shape (kinds, 3)
        Principal moments over mass, of the avatars and not of their clumps.
    diameters : float array, shape (kinds,)
        Nominal diameters, those of spheres of the same volume.
    reaches : float array, shape (kinds,)
        Radii of the clumps' bounding spheres about the centre of mass.
    unit : str
    """

    names: tuple[str, ...]
    avatars: tuple[Avatar, ...]
    clumps: tuple[Clump, ...]
    volumes: Float[np.ndarray, " kinds"]
    gyrations: Float[np.ndarray, "kinds 3"]
    diameters: Float[np.ndarray, " kinds"]
    reaches: Float[np.ndarray, " kinds"]
    unit: str

    def __len__(self) -> int:
        return len(self.names)


def prepare_kinds(
    avatars: Sequence[Avatar],
    names: Sequence[str] | None = None,
    *,
    spheres: int | Sequence[int] = 20,
    unit: str | None = None,
    progress: Progress | None = None,
    processes: int | None = None,
) -> GrainKinds:
    """Measure avatars, turn each into its principal frame and fit its clump.

    Parameters
    ----------
    avatars : sequence of Avatar
    names : sequence of str, optional
        By default made from the avatars' names and labels, as the export makes them.
    spheres : int or sequence of int
        Of each clump, or of each avatar's.
    unit : str, optional
        By default that of the first avatar.
    progress : callable(share, message), optional
    processes : int, optional
        For the clumps; as many as there are cores by default.

    Raises
    ------
    PackingError
        If there is no avatar, or one is in several pieces, hollow, or has no volume.
    """
    if not avatars:
        raise PackingError("There are no avatars to pack: fit some grains first.")
    unit = avatars[0].unit if unit is None else unit
    tell = progress or (lambda _share, _message: None)
    try:
        bodies = prepare_bodies(avatars, choose_names(avatars, names), unit, 1.0)
        many = [spheres] * len(bodies) if isinstance(spheres, int) else list(spheres)
        for number in sorted(set(many)):
            angular = [b.avatar for b, n in zip(bodies, many, strict=True) if n == number and b.avatar.n > 1]
            _fit_ahead(angular, number, tell, processes)
        clumps = tuple(_clump_of(body.avatar, n) for body, n in zip(bodies, many, strict=True))
    except ExportError as error:
        raise PackingError(str(error).replace("cannot be exported", "cannot be packed")) from error
    return GrainKinds(
        tuple(body.name for body in bodies),
        tuple(body.avatar for body in bodies),
        clumps,
        np.array([body.mass.volume for body in bodies]),
        np.array([body.mass.principal / body.mass.mass for body in bodies]),
        np.array([nominal_diameter(body.mass.volume) for body in bodies]),
        np.array([_reach(clump) for clump in clumps]),
        unit,
    )


def _fit_ahead(avatars: Sequence[Avatar], spheres: int, tell: Progress, processes: int | None) -> None:
    def tell_fitted(share: float, done: int) -> None:
        tell(share, f"Fitting spheres: {done} of {len(avatars)}")

    fit_ahead(avatars, spheres, tell_fitted, processes)


def _clump_of(avatar: Avatar, spheres: int) -> Clump:
    if avatar.n == 1:  # f = k / r**2 is one on a sphere of radius sqrt(k)
        return Clump(avatar.centers.copy(), np.sqrt(avatar.weights), avatar.unit)
    return sphere_clump(avatar, spheres)


def _reach(clump: Clump) -> float:
    return float((np.linalg.norm(clump.centers, axis=1) + clump.radii).max())


def sphere_avatars(diameters: Sequence[float] | Float[np.ndarray, " count"], unit: str) -> list[Avatar]:
    """Return spheres of some diameters, as avatars of one control point."""
    return [
        Avatar(np.zeros((1, 3)), np.array([(diameter / 2) ** 2]), unit, name=f"sphere_{number}")
        for number, diameter in enumerate(diameters, start=1)
    ]
