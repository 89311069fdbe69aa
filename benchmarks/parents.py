"""Populations of parents for the tables of MetaballVAE, serialized and measured once, kept on disk.

Usage: python benchmarks/parents.py [NAME ...] --cache FOLDER [--n 40]

Each population becomes FOLDER/NAME.npz: see `Parents`. A file that is there already is not made again.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from grain_kinds import cobble

from mbstudio.core.grains import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.serialize.serialization import Serialization, build_serialization, serialization_arrays

DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"

FACTORS = (
    "sphericity", "circularity", "dns", "csf", "volume", "area", "shortest", "intermediate", "longest",
)  # fmt: skip
UNIT = "um"


def implicit_mesh(value: Callable[[np.ndarray], np.ndarray], reach: float, side: int = 72) -> trimesh.Trimesh:
    """Return the closed surface of an implicit body, its corners moved onto the zero.

    Parameters
    ----------
    value : callable
        Negative inside.
    reach : float
        Half the edge of a cube about the origin that holds the body.
    side : int
        Cells across the body.
    """
    from skimage.measure import marching_cubes

    coarse = np.linspace(-reach, reach, 24)
    z, y, x = np.meshgrid(coarse, coarse, coarse, indexing="ij")
    near = value(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(x.shape) < 2 * reach / 23
    inside = np.argwhere(near)
    low, high = coarse[inside.min(axis=0)] - 2 * reach / 23, coarse[inside.max(axis=0)] + 2 * reach / 23
    step = float((high - low).max()) / side
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    field = value(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(x.shape)
    corners, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="ascent")
    points = corners[:, ::-1] * step + low[::-1]
    hair = 1e-3 * step
    for _ in range(3):
        here = value(points)
        slope = np.stack(
            [(value(points + d) - value(points - d)) / (2 * hair) for d in hair * np.eye(3)], axis=1
        )
        move = -slope * (here / np.maximum((slope**2).sum(axis=1), 1e-6))[:, None]
        length = np.linalg.norm(move, axis=1)
        points = points + move * np.minimum(1, 0.4 * step / np.maximum(length, 1e-12))[:, None]
    mesh = trimesh.Trimesh(points, faces, process=False)
    if mesh.body_count > 1:
        mesh = max(mesh.split(only_watertight=False), key=lambda part: abs(part.volume))
    if mesh.volume < 0:
        mesh.invert()
    mesh.units = UNIT
    return mesh


def sand_like(count: int, seed: int) -> list[trimesh.Trimesh]:
    """Return grains by the recipe of the sample scan: its kinds, shares and diameters."""
    from mbstudio.core.scan.phantom import sample_recipe
    from mbstudio.core.scan.phantom_grains import make_grain

    recipe, made = sample_recipe(), []
    kinds = list(recipe.kinds)
    shares = np.array([recipe.kinds[kind].share for kind in kinds])
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        kind = kinds[rng.choice(len(kinds), p=shares / shares.sum())]
        grain = make_grain(kind, float(rng.uniform(*recipe.kinds[kind].diameter)), rng)
        mesh = implicit_mesh(grain.body, grain.reach)
        mesh.apply_scale(recipe.voxel_size.x)
        mesh.metadata["name"] = f"{kind} {i}"
        mesh.units = UNIT
        made.append(mesh)
    return made


def cobble_like(count: int, seed: int) -> list[trimesh.Trimesh]:
    """Return ellipsoids with gentle waves, their sizes spread log-normally by 15 %."""
    made = []
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        body, size = cobble(rng), 1e4 * float(np.exp(0.15 * rng.standard_normal()))
        mesh = implicit_mesh(body, 1.25)
        mesh.apply_scale(size)
        mesh.metadata["name"] = f"cobble {i}"
        mesh.units = UNIT
        made.append(mesh)
    return made


def sand_ct(rows: slice) -> list[Grain]:
    """Return interior grains of the real sand scan as voxels, in an order that a seed fixed."""
    import mbstudio as mb

    grains = mb.segment(mb.open_scan(DATA / "sand_ct" / "sand_ct_14um.tif", voxel_size="14 um"))
    order = np.random.default_rng(2023).permutation(np.array(grains.interior_labels))
    return [grains.grain(int(label)) for label in order[rows]]


def meshes(folder: str, unit: str) -> list[trimesh.Trimesh]:
    """Return the closed meshes of a folder of real grains."""
    found = []
    for path in sorted((DATA / folder).glob("*.ply")):
        mesh = trimesh.load(path)
        if mesh.is_watertight:
            mesh.units, mesh.metadata["name"] = unit, path.stem
            found.append(mesh)
    return found


MAKERS: dict[str, Callable[[], Sequence[Grain | trimesh.Trimesh]]] = {
    "sand290": lambda: sand_like(290, 2023),
    "cobble20": lambda: cobble_like(20, 2023),
    "sandct250": lambda: sand_ct(slice(0, 250)),
    "aggregates48": lambda: meshes("aggregates", "mm"),
    "sand290_tuning": lambda: sand_like(290, 7),
    "cobble20_tuning": lambda: cobble_like(20, 7),
    "sandct250_tuning": lambda: sand_ct(slice(250, 500)),
    "cement24_tuning": lambda: meshes("cement", "um"),
}
TRUE_ONLY: dict[str, Callable[[], Sequence[Grain | trimesh.Trimesh]]] = {
    "sand1000_true": lambda: sand_like(1000, 11),
    "cobble1000_true": lambda: cobble_like(1000, 11),
}


def factors(bodies: Sequence[Grain | Avatar | trimesh.Trimesh], unit: str) -> dict[str, np.ndarray]:
    """Return the factors of bodies, NaN for one that cannot be measured."""
    from mbstudio.core.populations import measure_population

    measured = measure_population(list(bodies), range(len(bodies)), unit=unit, workers=0)
    return {name: measured.factors[name] for name in FACTORS}


@dataclass(frozen=True, eq=False)
class Parents:
    """A population of parents as it lies on disk.

    Attributes
    ----------
    serialization : Serialization or None
        None for a population that is only measured.
    avatars, truth : dict of str to float array
        `FACTORS` of the serialized avatars and of the bodies themselves, in the unit of the diameters.
    seconds : float
        CPU time of serializing one body, kernels compiled.
    """

    serialization: Serialization | None
    avatars: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]
    seconds: float


def load_parents(folder: str | Path, name: str) -> Parents:
    """Read a population that this module wrote."""
    with np.load(Path(folder) / f"{name}.npz", allow_pickle=False) as stored:
        arrays = {key: stored[key] for key in stored.files}
    groups = [
        {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
        for prefix in ("avatar_", "true_")
    ]
    held = build_serialization(arrays, name) if "centers" in arrays else None
    return Parents(held, groups[0], groups[1], float(arrays["seconds"]))


def make_parents(name: str, folder: Path, n: int) -> Parents:
    """Make, serialize and measure a population unless it is on disk already."""
    from mbstudio.core.vae.serialize.serializer import serialize

    path = folder / f"{name}.npz"
    if not path.exists():
        begin = time.process_time()
        bodies = (MAKERS.get(name) or TRUE_ONLY[name])()
        made, arrays, unit, spent = (
            time.process_time() - begin,
            {},
            "mm" if "aggregates" in name else UNIT,
            0.0,
        )
        if name in MAKERS:
            begin = time.process_time()
            held = serialize(bodies, n)
            spent = (time.process_time() - begin) / len(bodies)
            arrays = serialization_arrays(held)
            arrays |= {f"avatar_{key}": value for key, value in factors(held.avatars(), held.unit).items()}
            unit = held.unit
        arrays |= {f"true_{key}": value for key, value in factors(bodies, unit).items()}
        beside = path.with_suffix(".part")
        with beside.open("wb") as stream:
            np.savez_compressed(stream, seconds=spent, **arrays)
        beside.replace(path)
        print(f"{name}: {len(bodies)} bodies made in {made:.0f} s", flush=True)
    return load_parents(folder, name)


def row(name: str, parents: Parents) -> str:
    """Return a table row: how true and how fast the serialized avatars are."""
    held = parents.serialization
    assert held is not None
    good = held.valid
    volume, area = (100 * (parents.avatars[key] / parents.truth[key] - 1)[good] for key in ("volume", "area"))
    return (
        f"| {name} | {len(held)} | {held.template.n} | {100 * held.rms.mean():.2f} "
        f"| {100 * held.rms.max():.2f} | {100 * good.mean():.1f} | {np.abs(volume).mean():.3f} "
        f"| {area.mean():+.2f} | {np.abs(area).mean():.2f} | {parents.seconds:.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", default=[*MAKERS, *TRUE_ONLY])
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--n", type=int, default=40)
    chosen = parser.parse_args()
    chosen.cache.mkdir(parents=True, exist_ok=True)
    print(
        "| parents | bodies | n | rms % of D_n | largest | valid % | abs dV % | dA % | abs dA % "
        "| CPU s a body |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )
    for name in chosen.names:
        parents = make_parents(name, chosen.cache, chosen.n)
        if parents.serialization is not None:
            print(row(name, parents), flush=True)


if __name__ == "__main__":
    main()
