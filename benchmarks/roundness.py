"""Roundness of solids whose edges have a known radius, as meshes and as voxels.

``python benchmarks/roundness.py [--seed N]`` prints the table of docs/benchmarks.md. Poses follow from the
seed; the constants of ``mbstudio.core.metrics.roundness`` were chosen with seeds up to 1000.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.grains import Grain
from mbstudio.core.grains.voxelisation import voxelise
from mbstudio.core.metrics.bodies import prepare_measured_body
from mbstudio.core.metrics.roundness import roundness

BOXES = ((2, 2, 2), (4, 2, 2), (6, 6, 2), (6, 4, 2), (10, 10, 2), (20, 2, 2), (20, 20, 2))
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9)
CYLINDERS = ((1, 2), (1, 8), (4, 2), (10, 2))
RIMS = (0.0, 0.2, 0.5, 0.8)
ELLIPSOIDS = (
    (1, 1, 1), (1.1, 1.05, 1), (1.5, 1.2, 1), (2, 1, 1), (5, 1, 1), (10, 1, 1), (2, 2, 1), (3, 1.5, 1),
    (3, 3, 1), (5, 5, 1), (10, 10, 1),
)  # fmt: skip


def rounded_box(edges: tuple[float, float, float], radius: float) -> trimesh.Trimesh:
    """Return a box whose edges and corners are rounded by a radius."""
    if not radius:
        return trimesh.creation.box(edges)
    ball = trimesh.creation.icosphere(3, radius).vertices
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    corners = signs * (np.array(edges) / 2 - radius)
    return trimesh.convex.convex_hull((corners[:, None] + ball[None]).reshape(-1, 3))


def cylinder(radius: float, height: float, rim: float, sections: int = 192) -> trimesh.Trimesh:
    """Return a cylinder about z whose rims are rounded."""
    at = np.linspace(0, math.pi / 2, 25) if rim else np.zeros(1)
    out = radius - rim + rim * np.cos(at)
    up = height / 2 - rim + rim * np.sin(at) if rim else np.full(1, height / 2)
    around = np.arange(sections) * 2 * math.pi / sections
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    points = [
        np.column_stack([r * ring, np.full(sections, sign * z)])
        for r, z in zip(out, up, strict=True)
        for sign in (1, -1)
    ]
    return trimesh.convex.convex_hull(np.concatenate(points))


def roundness_of_ellipsoid(a: float, b: float, c: float) -> float:
    """Return the mean of 1 / k where the larger curvature k exceeds that of the inscribed sphere."""
    n = 400
    u, v = np.meshgrid((np.arange(2 * n) + 0.5) * math.pi / n, (np.arange(n) + 0.5) * math.pi / n)
    x, y, z = a * np.sin(v) * np.cos(u), b * np.sin(v) * np.sin(u), c * np.cos(v)
    along_u = np.stack([-a * np.sin(v) * np.sin(u), b * np.sin(v) * np.cos(u), 0 * u], axis=-1)
    along_v = np.stack([a * np.cos(v) * np.cos(u), b * np.cos(v) * np.sin(u), -c * np.sin(v)], axis=-1)
    area = np.linalg.norm(np.cross(along_u, along_v), axis=-1)
    h = 1 / np.sqrt(x**2 / a**4 + y**2 / b**4 + z**2 / c**4)
    gauss = h**4 / (a * b * c) ** 2
    mean = h**3 * (a * a + b * b + c * c - x * x - y * y - z * z) / (2 * (a * b * c) ** 2)
    largest = mean + np.sqrt(np.maximum(mean**2 - gauss, 0))
    inner = min(a, b, c)
    corner = largest > (1 + 1e-9) / inner
    return float((area[corner] / largest[corner]).sum() / area[corner].sum() / inner)


def as_voxels(mesh: trimesh.Trimesh, edge: float) -> Grain:
    """Return the voxels of a closed mesh whose numbers are mm."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    low = vertices.min(axis=0) - 3 * edge
    shape = np.ceil((vertices.max(axis=0) - low) / edge).astype(int)[::-1] + 4
    return Grain.from_mask(voxelise(vertices, faces, low, edge, tuple(int(n) for n in shape)), f"{edge} mm")


def solids() -> Iterator[tuple[str, str, trimesh.Trimesh, float, float, float]]:
    """Yield kind, name, body, longest and shortest side, and roundness; the inscribed radius is 1."""
    for sides in BOXES:
        for radius in EDGES:
            name = " : ".join(f"{side / 2:g}" for side in sides)
            yield "box", name, rounded_box(sides, radius), max(sides), min(sides), radius
    for radius, height in CYLINDERS:
        for rim in RIMS:
            body = cylinder(radius, height, rim)
            yield "cylinder", f"{2 * radius} x {height}", body, max(2 * radius, height), 2.0, rim
    ball = trimesh.creation.icosphere(6)
    for axes in ELLIPSOIDS:
        body = trimesh.Trimesh(ball.vertices * axes, ball.faces, process=False)
        name = " : ".join(f"{axis:g}" for axis in axes)
        yield "ellipsoid", name, body, 2.0 * max(axes), 2.0, roundness_of_ellipsoid(*axes)


def main() -> None:
    """Print one line a solid, and what is largest."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=5000)
    rng = np.random.default_rng(parser.parse_args().seed)
    print("| solid | sides | true | mesh | voxels, 60 to the longest side | 60 to the shortest |")
    print("|---|---|---|---|---|---|")
    off: dict[tuple[str, str], list[float]] = {}
    for kind, name, body, longest, shortest, true in solids():
        body.vertices = body.vertices @ Rotation.random(rng=rng).as_matrix().T + rng.uniform(-1, 1, 3)
        found = {"mesh": roundness(np.asarray(body.vertices), np.asarray(body.faces), 1.0)}
        for column, side in (("longest", longest), ("shortest", shortest)):
            if column == "shortest" and longest / shortest > 3:
                found[column] = math.nan  # hundreds of millions of voxels
                continue
            grain = prepare_measured_body(as_voxels(body, side / 60), None, "smoothed")
            found[column] = roundness(*grain.outline, 1.0, grain.voxel_edge)
        for column, value in found.items():
            if not math.isnan(value):
                off.setdefault((kind, column), []).append(value - true)
        told = " | ".join("–" if math.isnan(value) else f"{value:.3f}" for value in found.values())
        print(f"| {kind} | {name} | {true:.3f} | {told} |", flush=True)
    for (kind, column), errors in off.items():
        largest = max(errors, key=abs)
        print(
            f"{kind}, {column}: largest error {largest:+.3f}, mean {np.abs(errors).mean():.3f}, {len(errors)}"
        )


if __name__ == "__main__":
    main()
