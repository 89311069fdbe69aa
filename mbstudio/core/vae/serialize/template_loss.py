"""What grains lose when they are brought into one template: volume, and convexity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.mass import volume_integrals
from mbstudio.core.metrics.voxel_surface import check_grain, voxel_outline
from mbstudio.core.units import conversion_factor, parse_unit
from mbstudio.core.vae.serialize.serialization import Serialization

if TYPE_CHECKING:
    import trimesh

MOST = 24
"""Grains that are measured: more take long and change little."""
_CELLS = 96  # of avatars along their longest side


@dataclass(frozen=True)
class TemplateLoss:
    """Means over the grains that were measured.

    Attributes
    ----------
    volume : float
        Of the serialized avatars over that of the grains, less 1.
    convexity : float
        Of the serialized avatars, less that of the grains.
    grains : int
        How many were measured.
    """

    volume: float
    convexity: float
    grains: int


def measure_loss(
    bodies: Sequence[Grain | trimesh.Trimesh | Avatar],
    serialized: Serialization,
    *,
    unit: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> TemplateLoss | None:
    """Return what some of the grains lost, spread evenly; None where none could be measured.

    Parameters
    ----------
    bodies : sequence of Grain, trimesh.Trimesh or Avatar
        As they were given to the serializer, in the order of `serialized`.
    serialized : Serialization
    unit : str, optional
        Of meshes that carry none.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work.
    """
    rows = np.unique(np.linspace(0, len(bodies) - 1, MOST).round().astype(int)).tolist()
    found = []
    for place, row in enumerate(rows):
        if progress is not None:
            progress(place / len(rows), f"{place} of {len(rows)} grains")
        try:
            true, made = _measured(bodies[row], unit), _measured(serialized.avatar(row), None)
        except MbstudioError:
            continue  # a grain without a surface has nothing to lose
        scale = conversion_factor(true.unit, made.unit)
        found.append((made.volume / (true.volume * scale**3) - 1.0, made.convexity - true.convexity))
    if not found:
        return None
    volume, convexity = np.mean(found, axis=0)
    return TemplateLoss(float(volume), float(convexity), len(found))


class _Measured(NamedTuple):
    volume: float
    convexity: float
    unit: str


def _measured(body: Any, unit: str | None) -> _Measured:
    """Return volume and convexity of a body's surface: of voxels lightly smoothed, as they are measured."""
    from scipy.spatial import ConvexHull

    if isinstance(body, Grain):
        check_grain(body)
        vertices, faces = voxel_outline(body)
        own = body.voxel_size.unit
    elif isinstance(body, Avatar):
        mesh = body.mesh(cells=_CELLS)
        vertices, faces, own = mesh.vertices, mesh.faces, body.unit
    else:
        vertices, faces, own = body.vertices, body.faces, unit or body.units
    points = np.asarray(vertices, dtype=float)
    volume = float(volume_integrals(points - points.mean(axis=0), np.asarray(faces))[0])
    return _Measured(volume, volume / float(ConvexHull(points).volume), parse_unit(own))
