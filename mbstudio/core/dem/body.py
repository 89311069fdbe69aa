"""An avatar made ready for an engine: centre of mass at the origin, axes principal, pose kept apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.errors import ExportError, MbstudioError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.mass import MassProperties, mass_properties
from mbstudio.core.metrics.surface_distance import VerticesFaces
from mbstudio.core.metrics.surfaces import avatar_surface, pieces_and_voids
from mbstudio.core.units import conversion_factor

if TYPE_CHECKING:
    import trimesh

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_RESERVED = {
    "con",
    "prn",
    "aux",
    "nul",
    "manifest",
    "in",
    "settle",
    "templates",
    *(f"{p}{i}" for p in ("com", "lpt") for i in range(1, 10)),
}


@dataclass(frozen=True, eq=False)
class DemBody:
    """One avatar in its principal frame.

    Attributes
    ----------
    name : str
        A file name that every system and engine accepts.
    avatar : Avatar
        Centre of mass at the origin, principal axes along x, y, z (moments ascending), in the
        unit of the export.
    mass : MassProperties
        Of the avatar where it came from, in the unit of the export: the pose
        ``x_source = com + rotation @ x_principal`` and the moments.
    source : Avatar
    surface : pair of arrays, shapes (v, 3) and (f, 3), or None
        The surface of record in the frame of `avatar`, where that is handed over in the avatar's place: mass
        and pose are the surface's then.
    """

    name: str
    avatar: Avatar
    mass: MassProperties
    source: Avatar
    surface: VerticesFaces | None = None


def prepare_bodies(
    avatars: Sequence[Avatar], names: Sequence[str], unit: str, density: float | None,
    surfaces: Sequence[trimesh.Trimesh | None] | None = None,
) -> list[DemBody]:  # fmt: skip
    """Measure the avatars and turn each into its principal frame.

    Without a density the mass properties are those for 1 kg/m**3; only volume and pose count then. Where
    there is a surface, in the frame and unit of its avatar, it is measured in the avatar's place.

    Raises
    ------
    ExportError
        If an avatar is in several pieces, hollow, or has no volume.
    """
    given = [None] * len(avatars) if surfaces is None else surfaces
    return [
        _prepare(avatar, name, unit, density, surface)
        for avatar, name, surface in zip(avatars, names, given, strict=True)
    ]


def state_difference(body: DemBody, surface: trimesh.Trimesh) -> dict[str, Any]:
    """Return what the manifest says of an avatar beside the surface of record that it was fitted to.

    Parameters
    ----------
    body : DemBody
    surface : trimesh.Trimesh
        In the frame and unit of ``body.source``.
    """
    avatar = body.source
    volume = mass_properties(surface, 1.0, unit=avatar.unit).volume
    diameter = nominal_diameter(volume)
    distances = avatar.signed_distance(np.asarray(surface.vertices, dtype=float), iterated=True)
    factor = conversion_factor(avatar.unit, body.avatar.unit)
    return {
        "taken": body.surface is not None,
        "volume": volume * factor**3,
        "metaball_volume_error": mass_properties(avatar, 1.0).volume / volume - 1.0,
        "metaball_rms_over_Dn": float(np.sqrt(np.square(distances).mean())) / diameter,
        "metaball_largest_over_Dn": float(np.abs(distances).max()) / diameter,
    }


def _prepare(
    avatar: Avatar, name: str, unit: str, density: float | None, surface: trimesh.Trimesh | None
) -> DemBody:
    factor = conversion_factor(avatar.unit, unit)
    measured = avatar if surface is None else surface
    try:
        mass = mass_properties(measured, 1.0 if density is None else density, unit=avatar.unit).to(unit)
        voids = pieces_and_voids(*avatar_surface(avatar).coarse)[1]
    except MbstudioError as error:
        raise ExportError(f"'{name}' cannot be exported: {error}") from error
    if voids:
        raise ExportError(
            f"'{name}' cannot be exported: it encloses {voids} void(s), which an engine would fill or "
            "reject. Fit it again with more control points."
        )
    local = replace(
        avatar,
        centers=(avatar.centers * factor - mass.com) @ mass.rotation,
        weights=avatar.weights * factor**2,
        unit=unit,
        name=name,
    )
    if surface is None:
        return DemBody(name, local, mass, avatar)
    vertices = (np.asarray(surface.vertices, dtype=float) * factor - mass.com) @ mass.rotation
    return DemBody(name, local, mass, avatar, (vertices, np.asarray(surface.faces, dtype=np.int64)))


def choose_names(avatars: Sequence[Avatar], names: Sequence[str] | None) -> list[str]:
    """Return one file name for each avatar: those given, else made from the avatars' names and labels.

    Raises
    ------
    ExportError
        If a given name is no plain file name (letters, digits, ``_`` and ``-``), or occurs twice.
    """
    if names is None:
        return _made_names(avatars)
    if len(names) != len(avatars):
        raise ExportError(f"{len(names)} names were given for {len(avatars)} avatars: give one for each.")
    seen: set[str] = set()
    for name in names:
        if not _NAME.fullmatch(name) or name.lower() in _RESERVED:
            raise ExportError(
                f"'{name}' cannot be the name of an exported shape: use up to 64 letters, digits, '_' and "
                "'-', without spaces or slashes."
            )
        if name.lower() in seen:
            raise ExportError(f"The name '{name}' was given twice: give every shape its own.")
        seen.add(name.lower())
    return list(names)


def _made_names(avatars: Sequence[Avatar]) -> list[str]:
    made: list[str] = []
    seen: set[str] = set()
    for avatar in avatars:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", avatar.name).strip("_-")[:48] or "avatar"
        if avatar.label is not None and str(avatar.label) not in re.findall(r"\d+", stem):
            stem = f"{stem}_{avatar.label}"
        name, count = stem, 1
        while name.lower() in seen or name.lower() in _RESERVED:
            count += 1
            name = f"{stem}_{count}"
        seen.add(name.lower())
        made.append(name)
    return made


def is_unit_quaternion(parts: Sequence[float] | np.ndarray) -> bool:
    """Return whether four numbers are a quaternion of length 1; larger ones are not squared first."""
    found = np.asarray(parts, dtype=float)
    if found.shape != (4,) or not (np.abs(found) <= 1.1).all():
        return False
    return bool(abs(np.linalg.norm(found) - 1) <= 1e-6)


def is_finite(*arrays: object) -> bool:
    """Return whether every number in the arrays is finite."""
    return all(bool(np.isfinite(np.asarray(array, dtype=float)).all()) for array in arrays)
