"""Example scripts for files of no single engine: they load every shape and compare it with the manifest."""

from __future__ import annotations

from pathlib import Path

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.errors import ExportError

SCRIPT_NAME = "check_shapes.py"

MESH_SCRIPT = '''"""Compare the meshes beside it with manifest.json. Needs trimesh: python check_shapes.py

Volumes are those of the meshes, in the unit of the export; the manifest has those of the avatars, which the
meshes come near to. Ends with 1 if a mesh is open, inside out, off its centre, or off its volume by 2 %.
"""

import json
import sys
from pathlib import Path

import trimesh

FOLDER = Path(__file__).resolve().parent


def load(manifest):
    """Return every mesh by its name, with the manifest's entry."""
    return {item["name"]: (trimesh.load_mesh(FOLDER / item["files"][0]), item) for item in manifest["items"]}


def faults(mesh, item):
    """Return what is wrong with a mesh, in words."""
    size = item["volume"] ** (1 / 3)
    found = []
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return ["not closed"]
    if mesh.volume <= 0:
        return ["inside out"]
    if abs(mesh.volume / item["volume"] - 1) > 0.02:
        found.append("another volume")
    if max(abs(float(value)) for value in mesh.center_mass) > 0.01 * size:
        found.append("off its centre of mass")
    return found


def main():
    manifest = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))
    bad = 0
    print("SHAPE triangles volume ratio (lengths in %s)" % manifest["unit"])
    for name, (mesh, item) in load(manifest).items():
        found = faults(mesh, item)
        bad += bool(found)
        ratio = mesh.volume / item["volume"]
        print(name, len(mesh.faces), "%.9g" % mesh.volume, "%.6f" % ratio, ", ".join(found) or "good")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
'''

METABALL_SCRIPT = '''"""Compare the metaballs with manifest.json. Needs NumPy: python check_shapes.py

The volume is counted on a grid of 96 cells along the longest side: within 2 % of the manifest's. Ends with 1
if a metaball is off its volume or its centre.
"""

import json
import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parent
CELLS = 96


def load(manifest):
    """Return the rows x, y, z, k of every metaball by its name, with the manifest's entry."""
    tables = {}
    for item in manifest["items"]:
        table = np.loadtxt(FOLDER / item["files"][0], delimiter=",", skiprows=1, ndmin=2)
        tables[item["name"]] = (table, item)
    return tables


def field(table, points):
    """Return f = sum of k / distance**2 at points; the solid is f >= 1."""
    value = np.zeros(len(points))
    for x, y, z, k in table:
        value += k / np.maximum(((points - (x, y, z)) ** 2).sum(axis=1), 1e-300)
    return value


def volume_and_centre(table):
    """Return the volume and the centre of mass of a metaball, counted on a grid."""
    # Where the sum of k over the squared distance to the nearest point is below 1, the field is too.
    reach = np.sqrt(table[:, 3].sum())
    low, high = table[:, :3].min(axis=0) - reach, table[:, :3].max(axis=0) + reach
    for _ in range(3):  # the first grids find the box around the solid
        step = (high - low).max() / CELLS
        axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = points[field(table, points) >= 1]
        low, high = inside.min(axis=0) - 2 * step, inside.max(axis=0) + 2 * step
    return len(inside) * step**3, inside.mean(axis=0)


def main():
    manifest = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))
    bad = 0
    print("SHAPE points volume ratio (lengths in %s)" % manifest["unit"])
    for name, (table, item) in load(manifest).items():
        volume, centre = volume_and_centre(table)
        ratio = volume / item["volume"]
        good = abs(ratio - 1) < 0.02 and np.abs(centre).max() < 0.02 * item["volume"] ** (1 / 3)
        bad += not good
        print(name, len(table), "%.6g" % volume, "%.4f" % ratio, "good" if good else "not the manifest's")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
'''


def write_script(folder: Path, script: str) -> str:
    """Write a script that checks the shapes beside it; return its name."""
    (folder / SCRIPT_NAME).write_text(script, encoding="ascii")
    return SCRIPT_NAME


def check_script(folder: Path, script: str) -> None:
    """Raise ExportError unless the script is the one that mbstudio writes."""
    if read_text(folder / SCRIPT_NAME) != script:
        raise ExportError(f"{folder / SCRIPT_NAME} is not the script that mbstudio writes: export again.")
