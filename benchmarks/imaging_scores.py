"""What the tables of Metaball-Imaging tell of one fit against the true surface."""

from __future__ import annotations

import time

import numpy as np
import trimesh
from grain_kinds import KnownGrain

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit


def surface_distances(
    avatar: trimesh.Trimesh, truth: trimesh.Trimesh, points: int = 20_000
) -> tuple[float, float]:
    """Return Chamfer and Hausdorff distance of two closed meshes."""
    import pyvista as pv

    means, largest = [], []
    for source, target in ((avatar, truth), (truth, avatar)):
        sampled = np.asarray(trimesh.sample.sample_surface(source, points, seed=1)[0])
        _, nearest = pv.PolyData.from_regular_faces(target.vertices, target.faces).find_closest_cell(
            sampled, return_closest_point=True
        )
        distance = np.linalg.norm(sampled - nearest, axis=1)
        means.append(distance.mean())
        largest.append(distance.max())
    return float(np.mean(means)), float(max(largest))


def handles_of_voxels(grain: Grain) -> int:
    """Return the handles of a grain's voxels, joined through corners too, its cavities filled."""
    import fill_voids
    from skimage.measure import euler_number

    return 1 - int(euler_number(fill_voids.fill(np.pad(grain.mask, 1)) > 0, connectivity=3))


def score(known: KnownGrain, result: FitResult, seconds: float) -> dict[str, float]:
    """Return the figures of one fit against the true surface."""
    mesh = result.avatar.mesh(cells=128)
    truth = known.truth
    dn = (6 * truth.volume / np.pi) ** (1 / 3)
    chamfer, hausdorff = surface_distances(mesh, truth)
    verdict = result.verdict
    return {
        "dV": 100 * (mesh.volume / truth.volume - 1), "dA": 100 * (mesh.area / truth.area - 1),
        "chamfer": 100 * chamfer / dn, "hausdorff": 100 * hausdorff / dn, "cpu": seconds,
        "pieces": verdict.pieces, "voids": verdict.voids, "outside": verdict.points_outside,
        "valid": verdict.valid,
        "genus_wrong": verdict.genus != handles_of_voxels(known.grain),
        "truth_missed": verdict.genus != round(1 - truth.euler_number / 2),
    }  # fmt: skip


def timed_fit(grain: Grain, n: int, **options: object) -> tuple[FitResult, float]:
    begin = time.process_time()
    result = fit(grain, n, **options)  # type: ignore[arg-type]
    return result, time.process_time() - begin
