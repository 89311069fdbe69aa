"""How well shaped and how near the meshes are that engines get of real grains' avatars; a Markdown table.

Usage: python benchmarks/meshes.py --cache FOLDER [--sets aggregates48 sandct250 cobble20] [--cells 8 16 32]

The avatars are those of benchmarks/parents.py, made first if they are not in the cache.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from parents import load_parents, make_parents

from mbstudio.core.dem.shapes.mesh_target import MeshErrors
from mbstudio.core.dem.shapes.remesh import angles_of, well_shaped_mesh
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics.mass import mass_properties


def row(name: str, avatars: list[Avatar], cells: int) -> str:
    """Mesh all avatars of a set and return a line of the table."""
    smallest, errors, triangles, closed = [], [], [], True
    begun = time.process_time()
    for avatar in avatars:
        volume = mass_properties(avatar, 1.0).volume
        mesh = well_shaped_mesh(avatar, cells, volume)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        smallest.append(float(np.degrees(angles_of(vertices, faces).min())))
        errors.append(100 * MeshErrors(avatar, nominal_diameter(volume)).measure((vertices, faces)))
        triangles.append(len(faces))
        closed = closed and bool(mesh.is_watertight and mesh.is_winding_consistent)
    seconds = (time.process_time() - begun) / len(avatars)
    told = (
        name, f"{len(avatars)}", f"{cells}", f"{np.median(triangles):.0f}", f"{min(smallest):.1f}",
        f"{np.median(smallest):.1f}", f"{np.median(errors):.2f}", f"{max(errors):.2f}",
        "yes" if closed else "NO", f"{seconds:.2f}",
    )  # fmt: skip
    return f"| {' | '.join(told)} |"


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cache", type=Path, required=True)
    options.add_argument("--sets", nargs="+", default=["aggregates48", "sandct250", "cobble20"])
    options.add_argument("--cells", type=int, nargs="+", default=[8, 16, 32])
    given = options.parse_args()
    print(
        "| avatars | number | cells | triangles, median | smallest angle (°), worst | median "
        "| Hausdorff over D_n (%), median | worst | all closed | CPU s each |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in given.sets:
        if not (given.cache / f"{name}.npz").exists():
            make_parents(name, given.cache, 40)
        avatars = load_parents(given.cache, name).serialization.avatars()
        for cells in given.cells:
            print(row(name, avatars, cells), flush=True)


if __name__ == "__main__":
    main()
