"""ComFluSoM metaballs: control points as CSV, and the C++ calls that add them.

ComFluSoM reads no files: ``<name>.csv`` (header ``x,y,z,k``) is for people and scripts, ``add_metaballs.h``
holds the ``AddMetaball(tag, rs, points, k, rho)`` calls. Its k is ours. It meshes every metaball by rays from
the mean control point, each by Newton's method from r = 1, and aborts where that ends below zero. Whether it
does depends on the scale: so all avatars are scaled together as suits the search best, the same search is
tried here, and an avatar on which it fails is warned of.

Source: ComFluSoM, Library/DEM/METABALL.h (Zhang et al., the paper's authors).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Bool

from mbstudio.core.dem.formats.metaball import check_body, read_table, write_table
from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import AvatarError, ExportError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.sphere_directions import half_sphere
from mbstudio.core.options import Option

_CALLS = "add_metaballs.h"
_ENOUGH = 1e-12
_MOST = 10000


def write(job: Job) -> Written:
    """Write a table for each body, and one header with the calls for all."""
    radius = float(np.median([(3 * body.mass.volume / (4 * np.pi)) ** (1 / 3) for body in job.bodies]))
    scale = search_scale([body.avatar for body in job.bodies], radius) if job.options["scaled"] else 1.0
    details = []
    text = (
        "// Include where d is a DEM*: each call adds one avatar.\n"
        f"// Lengths are {scale:.12g} times those in {job.unit}; k has the square of that.\n"
    )
    for number, body in enumerate(job.bodies):
        job.progress(number / len(job.bodies), f"Writing {body.name}")
        scaled = body.avatar.scaled(scale)
        write_table(job.folder / f"{body.name}.csv", scaled)
        text += _call(number, body.name, scaled)
        astray = float(1.0 - search_succeeds(scaled).mean())
        warnings = []
        if astray > 0:
            warnings.append(
                f"'{body.name}': ComFluSoM's search from the mean control point goes astray in "
                f"{100 * astray:.3g} % of the directions; it would abort."
            )
        details.append(
            {
                "control_points": body.avatar.n,
                "scale": scale,
                "directions_astray": astray,
                "warnings": warnings,
            }
        )
    (job.folder / _CALLS).write_text(text, encoding="ascii")
    return Written([(f"{body.name}.csv",) for body in job.bodies], details, (_CALLS,))


def _call(number: int, name: str, avatar: Avatar) -> str:
    points = ",\n".join(f"        {{{x:.17g}, {y:.17g}, {z:.17g}}}" for x, y, z in avatar.centers)
    weights = ", ".join(f"{weight:.17g}" for weight in avatar.weights)
    return (
        f"\n{{ // {name}\n    vector<Vector3d> P = {{\n{points}\n    }};\n"
        f"    VectorXd K({avatar.n});\n    K << {weights};\n"
        f"    d->AddMetaball({-(number + 1)}, rs, P, K, rho);\n}}\n"
    )


def search_scale(avatars: Sequence[Avatar], radius: float) -> float:
    """Return the common factor by which ComFluSoM's search goes astray in the fewest directions.

    Of lengths that make `radius` 0.4 to 2.5: the middle one of those that do equally well.

    Parameters
    ----------
    avatars : sequence of Avatar
    radius : float
        A typical radius of the avatars, in their unit.
    """
    factors = np.geomspace(0.4, 2.5, 23) / radius
    astray = [
        sum(np.count_nonzero(~search_succeeds(avatar.scaled(factor), 320)) for avatar in avatars)
        for factor in factors
    ]
    best = np.flatnonzero(np.array(astray) == min(astray))
    return float(f"{factors[best[len(best) // 2]]:.3g}")


def search_succeeds(avatar: Avatar, count: int = 1280) -> Bool[np.ndarray, " directions"]:
    """Return for evenly spread directions whether ComFluSoM's search for the surface ends well.

    Newton's method on f(c + r n) - 1 from r = 1, c the mean control point, which stops as soon as the
    value is below 1e-12; ComFluSoM aborts if r is below zero then (and bisects otherwise).

    Parameters
    ----------
    avatar : Avatar
        In the lengths that ComFluSoM gets.
    count : int
        Of the directions.
    """
    half = half_sphere(count // 2)
    directions = np.concatenate([half, -half])
    center = avatar.centers.mean(axis=0)
    radius = np.ones(len(directions))
    going = np.ones(len(directions), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(_MOST):
            points = center + radius[going, None] * directions[going]
            value = avatar.field(points) - 1.0
            slope = np.einsum("ij,ij->i", avatar.gradient(points), directions[going])
            radius[going] -= value / slope
            going[going] = (value >= _ENOUGH) & np.isfinite(radius[going])
            if not going.any():
                break
    return (radius > 0) & np.isfinite(radius) & ~going


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read tables and calls back and compare them with each other and the manifest.

    Raises
    ------
    ExportError
        If a table is broken or another avatar, or the calls do not hold its numbers.
    """
    calls = read_text(folder / _CALLS)
    for item in manifest["items"]:
        path = folder / item["files"][0]
        rows = read_table(path)
        try:
            scaled = Avatar(rows[:, :3], rows[:, 3], manifest["unit"], name=item["name"])
        except AvatarError as error:
            raise ExportError(f"{path} does not contain a metaball: {error}") from error
        if scaled.n != item["details"]["control_points"]:
            raise ExportError(f"The number of control points in {path} differs from the manifest.")
        check_body(path, scaled.scaled(1 / item["details"]["scale"]), item)
        body = _call(0, item["name"], scaled).partition("    d->AddMetaball")[0]
        if body not in calls:
            raise ExportError(f"{folder / _CALLS} does not add the control points of {path.name}.")
    if calls.count("AddMetaball(") != len(manifest["items"]):
        raise ExportError(f"{folder / _CALLS} does not add every avatar once.")


TARGET = Target(
    name="comflusom",
    title="ComFluSoM metaballs",
    geometry="metaball",
    needs_density=False,
    default_unit="mm",
    write=write,
    validate=validate,
    options=MappingProxyType(
        {"scaled": Option(True, "scale all avatars together so that ComFluSoM's search converges")}
    ),
)
