"""What every clump target shares: fitting the spheres, describing them, checking them when read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.reading_back import number_rows, read_text
from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.dem.shapes.clump_goal import ClumpGoal, clump_for_target
from mbstudio.core.dem.shapes.many_clumps import fit_ahead
from mbstudio.core.dem.specimen.deck_cost import HOURS
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.options import Option

CLUMP_GOAL = "clump_target"
POURED = Option(10, "particles that the example deck pours", 1, 100000)
OPTIONS = MappingProxyType(
    {
        "spheres": Option(40, "spheres in each clump", 2, 2000),
        CLUMP_GOAL: Option(
            "",
            "goal of each clump, instead of a number of spheres: iou 0.95, hausdorff 3 %, "
            "volume 1 %, inertia 1 %, joined by 'and'; 'and n 200' sets the most spheres",
        ),
    }
)
WITH_DECK: Mapping[str, Option] = MappingProxyType({**OPTIONS, "poured": POURED})
WITH_TIMED_DECK: Mapping[str, Option] = MappingProxyType({**WITH_DECK, "hours": HOURS})


def fitted_clumps(job: Job) -> list[Clump]:
    """Fit a clump to every body of an export, in its principal frame.

    What became of a target goes into ``job.remarks``, by the names of the bodies.
    """
    target = str(job.options[CLUMP_GOAL]).strip()
    wanted = ClumpGoal.parse(target) if target else None
    spheres = int(job.options["spheres"])
    fit_ahead(
        [body.avatar for body in job.bodies],
        spheres if wanted is None else wanted,
        lambda share, done: job.progress(0.95 * share, f"Fitting spheres: {done} of {len(job.bodies)}"),
    )
    clumps = []
    for index, body in enumerate(job.bodies):
        before = index / len(job.bodies)
        job.progress(before, f"Fitting spheres to {body.name}")
        if wanted is None:
            clumps.append(sphere_clump(body.avatar, spheres))
            continue
        tell = partial(_pass_progress, job, before, body.name)
        found = clump_for_target(body.avatar, wanted, progress=tell, fit=sphere_clump)
        remarks = job.remarks.setdefault(body.name, {})
        remarks |= {"clump_target": str(wanted), "reached": dict(found.values)}
        if found.warning:
            remarks["warnings"] = [f"{body.name}: {found.warning}"]
        clumps.append(found.clump)
    return clumps


def _pass_progress(job: Job, before: float, name: str, _fraction: float, said: str) -> None:
    job.progress(before, f"{name}: {said}")


def sphere_rows(clump: Clump) -> Float[np.ndarray, "n 4"]:
    """Return the rows x, y, z, r of a clump."""
    return np.column_stack([clump.centers, clump.radii])


def describe_clump(clump: Clump, body: DemBody) -> dict[str, Any]:
    """Return what the manifest says about a clump."""
    diameter = nominal_diameter(body.mass.volume)
    return {
        "spheres": len(clump.radii),
        "smallest_radius": float(clump.radii.min()),
        "largest_radius": float(clump.radii.max()),
        "iou": clump.iou,
        "volume_ratio": clump.volume_ratio,
        "inertia_error": clump.inertia_error,
        "mean_distance": clump.mean_distance,
        "hausdorff": clump.hausdorff,
        "hausdorff_over_nominal_diameter": clump.hausdorff / diameter,
    }


def describe_clumps(clumps: Sequence[Clump], bodies: Sequence[DemBody]) -> list[dict[str, Any]]:
    """Return what the manifest says about each clump."""
    return [describe_clump(clump, body) for clump, body in zip(clumps, bodies, strict=True)]


def write_sphere_table(path: Path, clump: Clump, header: str = "") -> None:
    """Write a clump as comma-separated rows x, y, z, r, after a header line if there is one."""
    rows = [",".join(f"{value:.12e}" for value in row) for row in sphere_rows(clump)]
    path.write_text("\n".join([header, *rows] if header else rows) + "\n", encoding="ascii")


def check_sphere_table(path: Path, item: Mapping[str, Any], header: str = "") -> None:
    """Raise ExportError unless comma-separated rows x, y, z, r are the clump that the manifest describes.

    Engines swallow a missing header (the first sphere is lost) or a misspelt one (radii become zero).
    """
    lines = read_text(path).splitlines()
    if header:
        if lines[:1] != [header]:
            said = lines[0] if lines else ""
            raise ExportError(f"{path} has the header '{said}' instead of '{header}'.")
        lines = lines[1:]
    check_spheres(path, number_rows(path, lines, 4, ","), item)


def check_spheres(
    path: Path, rows: Float[np.ndarray, "n 4"], item: Mapping[str, Any], tolerance: float = 1e-6
) -> None:
    """Raise ExportError unless rows x, y, z, r are the clump that the manifest describes.

    Parameters
    ----------
    path : Path
        For messages.
    rows : float array, shape (n, 4)
        In the unit of the manifest, centre of mass at the origin.
    item : mapping
        The manifest's entry.
    tolerance : float
        Relative, of the radii: what the file's digits allow.
    """
    if len(rows) < 2:
        raise ExportError(f"{path} has {len(rows)} spheres; a clump needs at least 2.")
    if len(rows) != item["details"]["spheres"]:
        raise ExportError(f"{path} has {len(rows)} spheres; the manifest says {item['details']['spheres']}.")
    if not np.isfinite(rows).all() or rows[:, 3].min() <= 0:
        raise ExportError(f"{path} has numbers that are not finite, or a radius that is not positive.")
    reach = (np.linalg.norm(rows[:, :3], axis=1) + rows[:, 3]).max()
    size = nominal_diameter(item["volume"])
    smallest, largest = rows[:, 3].min(), rows[:, 3].max()
    stated = item["details"]["smallest_radius"], item["details"]["largest_radius"]
    if not 0.4 * size < reach < 20 * size or not np.allclose((smallest, largest), stated, rtol=tolerance):
        raise ExportError(f"{path} has spheres whose size differs from the manifest.")
