"""Features of many bodies, on several processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int

from mbstudio.core.batch.body_messages import body_from, body_message
from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.errors import MbstudioError, MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.judging.features import Features, body_features
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import check_mesh
from mbstudio.core.metrics.voxel_surface import voxel_outline

if TYPE_CHECKING:
    import trimesh

    Body = Grain | Avatar | trimesh.Trimesh

Progress = Callable[[float, str], None]
Surface = tuple[Float64[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]

AVATAR_CELLS = 96
"""Cells along the longest side of an avatar that is judged: triangles of about 0.015 D_n."""
_FEWEST_FOR_PROCESSES = 24


def surface_of(body: Body) -> Surface:
    """Return the closed surface by which a body is judged.

    Of a grain its lightly smoothed outline, of an avatar a fine mesh of its surface.

    Raises
    ------
    MeshError, AvatarError, GrainError
        If there is none.
    """
    if isinstance(body, Grain):
        vertices, faces = voxel_outline(body)
        return np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    mesh = body.mesh(AVATAR_CELLS) if isinstance(body, Avatar) else check_mesh(body)
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def measure_features(
    bodies: Sequence[Body], *, workers: int | None = None, progress: Progress | None = None
) -> list[Features | str]:
    """Return the features of each body, or why it has none.

    Parameters
    ----------
    bodies : sequence of Grain, Avatar or trimesh.Trimesh
    workers : int, optional
        Processes; one a core by default. 0 measures in the calling thread, as do fewer than 24 bodies
        unless a number is given.
    progress : callable, optional
        ``progress(share, message)`` after each body; what it raises ends the work at once.
    """
    if workers is None:
        workers = usable_cores() if len(bodies) >= _FEWEST_FOR_PROCESSES else 0
    if workers < 0:
        raise MeasureError(
            f"The number of processes must be 1 or more, or 0 for the calling thread, not {workers}."
        )
    found: list[Features | str] = ["It was not measured."] * len(bodies)
    if not bodies:
        return found
    with closing(WorkerPool(_FeatureJob(), workers).as_completed(list(bodies))) as results:
        for done, (place, features) in enumerate(results, start=1):
            found[place] = features
            if progress is not None:
                progress(done / len(bodies), f"{done} of {len(bodies)} bodies")
    return found


class _FeatureJob(Job["Body", "Features | str"]):
    """In goes a body, out come its features, or why it has none."""

    def pack(self, body: Body) -> Message:
        return body_message(body)

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        found = body_features(*surface_of(body_from(head, arrays)))
        stated = {"overhang": found.overhang, "triangle_edge": found.triangle_edge, "notes": found.notes}
        return stated, {"values": found.values, "log_radii": found.log_radii}

    def unpack(self, body: Body, head: Head, arrays: Arrays) -> Features | str:
        return Features(
            np.array(arrays["values"]), np.array(arrays["log_radii"]), head["overhang"],
            head["triangle_edge"], tuple(head["notes"]),
        )  # fmt: skip

    def fail(self, body: Body, error: MbstudioError) -> Features | str:
        return str(error)

    def lose(self, body: Body, code: int) -> Features | str:
        return f"The process that measured it ended with code {code}."
