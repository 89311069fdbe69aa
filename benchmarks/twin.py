"""The in-place twin beside the fit to labels, on packings that are known exactly; Markdown tables.

Usage: python benchmarks/twin.py [--rows smooth,noise,cupped,angular] [--seeds 101,102,103] [--count 20]
       python benchmarks/twin.py --sand ../shared/data/sand_ct/sand_ct_14um.tif

Each packing has so many grains, of equal shares of the row's kinds: they just touch, but every third has a
gap of 0.1 to 0.5 voxel to the one that it is nearest to. Errors with +- are standard errors over the
packings. Surfaces: root mean square distance of points of the avatars' surfaces to the true ones, in
voxels, where another grain is farther than 2 voxels ("free") and where it is nearer ("contact"); the bias
is the mean where free. Volumes: median of the absolute error in %, and its root mean square. A contact is
found where the probability is 0.5 or more (of labels: where the gap is 0.1 voxel or less), and true where
the bodies' gap is 0.02 voxel at most; pairs whose gap lies between that and 0.1 voxel count for nothing.
Normals: median angle to the true normal, in degrees. Gap: mean and standard deviation of the gap's error at
true contacts, in voxels. Covered: share of true gaps within 1.96 of their deviations.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from twin_phantoms import Body, Truth, gap, pack, scan_of

import mbstudio as mb
from mbstudio.core.metaball import Avatar
from mbstudio.core.twin.contacts import TOUCHING, contact_table
from mbstudio.core.twin.twinning import TwinRun
from mbstudio.core.units import VoxelSize

SMOOTH, ANGULAR = ("ellipsoid", "metaball"), ("angular", "concave")
ROWS: dict[str, list[tuple[str, tuple[str, ...], float, int, dict[str, float]]]] = {
    "smooth": [
        (f"smooth, {across:g} across, noise {noise:g}", SMOOTH, across, 40, {"noise": noise})
        for across in (12.6, 18.0, 28.0)
        for noise in (0.035, 0.05)
    ],
    "noise": [("smooth, 28 across, noise 0.1", SMOOTH, 28.0, 40, {"noise": 0.1})],
    "cupped": [
        ("smooth, 28 across, cupping 8 %, rings 5 %", SMOOTH, 28.0, 40, {"cupping": 0.08, "rings": 0.05})
    ],
    "angular": [
        (f"angular and concave, 28 across, n = {n}", ANGULAR, 28.0, n, {"noise": 0.035}) for n in (40, 80)
    ],
    "spheres": [
        (f"balls, {across:g} across", ("sphere",), across, 40, {"noise": 0.035}) for across in (12.7, 25.0)
    ],
}
_TRUE_CONTACT, _TRUE_APART = 0.02, 0.1
_CLOSE = 2.0  # voxels to another grain where a surface is no longer free
_EDGE = 14.0  # um


def matched(truth: Truth, grains: mb.GrainSet) -> dict[int, int]:
    """Return the body of each label: the one that most of its voxels belong to, and it holds most of."""
    pairs = np.stack((grains.labels.ravel(), truth.owner.ravel()), axis=1)
    found: dict[int, int] = {}
    for label in grains.table["label"].tolist():
        owners = np.bincount(pairs[pairs[:, 0] == label, 1])
        body = int(owners.argmax())
        if body and owners[body] > 0.8 * np.count_nonzero(truth.owner == body):
            found[label] = body - 1
    return found


def surface_errors(avatar: Avatar, body: Body, others: list[Body]) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of an avatar's surface to a body, in voxels: where it is free, and at contacts."""
    mesh = avatar.mesh(cells=48)
    rng = np.random.default_rng(0)
    faces = rng.choice(len(mesh.faces), 1500, p=mesh.area_faces / mesh.area)
    corners = rng.dirichlet((1, 1, 1), 1500)
    places = (mesh.triangles[faces] * corners[..., None]).sum(axis=1) / _EDGE
    nearest = np.full(len(places), np.inf)
    for other in others:
        if np.linalg.norm(other.middle - body.middle) < 80:
            nearest = np.minimum(nearest, other.distance(places))
    # A triangle lies inside its surface: take the avatar's own distance off.
    away = body.distance(places) - avatar.signed_distance(places * _EDGE) / _EDGE
    return away[nearest > _CLOSE], away[nearest <= _CLOSE]


def true_pairs(bodies: list[Body]) -> dict[tuple[int, int], tuple[float, np.ndarray]]:
    """Return gap and normal of all pairs that are less than 2 voxels apart."""
    found = {}
    for i, body in enumerate(bodies):
        for j in range(i + 1, len(bodies)):
            away, _, normal = gap(body, bodies[j])
            if away < 2:
                found[i, j] = (away, normal)
    return found


def score_contacts(
    table: pd.DataFrame, of: Mapping[int, int], pairs: dict[tuple[int, int], tuple[float, np.ndarray]]
) -> dict[str, float]:
    """Return counts of right, wrong and missed contacts, and the errors of normals and gaps."""
    known = set(of.values())
    wanted = {pair for pair, (away, _) in pairs.items() if away <= _TRUE_CONTACT and set(pair) <= known}
    unclear = {pair for pair, (away, _) in pairs.items() if _TRUE_CONTACT < away <= _TRUE_APART}
    right = wrong = 0
    angles, errors, covered = [], [], []
    for row in table.to_dict("records"):
        if row["a"] not in of or row["b"] not in of:
            continue
        i, j = of[row["a"]], of[row["b"]]
        pair, sign = ((i, j), 1) if i < j else ((j, i), -1)
        touches = row["probability"] >= 0.5
        if pair in wanted:
            normal = sign * np.array([row["nx"], row["ny"], row["nz"]])
            angles.append(np.degrees(np.arccos(np.clip(normal @ pairs[pair][1], -1, 1))))
            errors.append(row["gap"] / _EDGE - pairs[pair][0])
            covered.append(abs(errors[-1]) < 1.96 * row["gap_deviation"] / _EDGE)
            right += touches
        elif touches and pair not in unclear:
            wrong += 1
    precision, recall = right / max(right + wrong, 1), right / max(len(wanted), 1)
    return {
        "F1": 2 * precision * recall / max(precision + recall, 1e-9), "precision": precision,
        "recall": recall, "normal": float(np.median(angles)), "gap": float(np.mean(errors)),
        "gap sd": float(np.std(errors)),
        "covered": float(np.mean(covered)), "contacts": len(wanted),
    }  # fmt: skip


def score(
    avatars: Mapping[int, Avatar], table: pd.DataFrame, of: Mapping[int, int], truth: Truth,
    pairs: dict[tuple[int, int], tuple[float, np.ndarray]],
) -> dict[str, float]:  # fmt: skip
    """Return all errors of the avatars of one packing."""
    free, close, volumes = [], [], []
    for label, number in of.items():
        body = truth.bodies[number]
        others = [other for other in truth.bodies if other is not body]
        one, other = surface_errors(avatars[label], body, others)
        free.append(one)
        close.append(other)
        volume = avatars[label].mesh(cells=96).volume / _EDGE**3
        volumes.append(100 * (volume / body.volume - 1))
    free, close, volumes = np.concatenate(free), np.concatenate(close), np.array(volumes)
    return {
        "free": float(np.sqrt((free**2).mean())), "bias": float(free.mean()),
        "contact": float(np.sqrt((close**2).mean())), "volume": float(np.median(np.abs(volumes))),
        "volume rms": float(np.sqrt((volumes**2).mean())), **score_contacts(table, of, pairs),
    }  # fmt: skip


def one_packing(
    kinds: tuple[str, ...], across: float, n: int, how: dict[str, float], seed: int, count: int
) -> tuple[dict[str, float], dict[str, float], int, int]:
    """Return the scores of the fit to labels and of the twin, and how many grains of how many were found."""
    truth = scan_of(pack(kinds, across, count, seed), seed, **how)
    scan = mb.Scan(truth.voxels, VoxelSize.parse(f"{_EDGE} um"))
    grains = mb.segment(scan)
    of, pairs = matched(truth, grains), true_pairs(truth.bodies)
    before = TwinRun(scan, grains, n=n, workers=0)
    bodies = before.begin().bodies
    fits = {body.label: before.frame.avatar_of(body.start, body.label, "") for body in bodies}
    labels = contact_table(before.begin())
    # Labels tell of no deviation: a gap of no more than what they are known to be wide is a contact.
    labels["probability"] = (labels["gap"] <= TOUCHING * _EDGE).astype(float)
    begun = time.process_time()
    found = mb.twin(scan, grains, fits, workers=0)
    seconds = (time.process_time() - begun) / len(grains)
    cost = {"seconds": seconds, "blur": found.blur / _EDGE}
    return (
        score(fits, labels, of, truth, pairs),
        {**score(found.avatars, found.contacts, of, truth, pairs), **cost},
        len(of),
        count,
    )


_TABLE = (
    ("free", 3), ("bias", 3), ("contact", 3), ("volume", 2), ("volume rms", 2), ("F1", 3), ("precision", 3),
    ("recall", 3), ("normal", 2), ("gap", 3), ("gap sd", 3), ("covered", 2), ("seconds", 2),
)  # fmt: skip


def cells_of(scores: list[dict[str, float]]) -> str:
    """Return means over the packings with their standard errors."""
    cells = []
    for name, digits in _TABLE:
        values = np.array([one.get(name, np.nan) for one in scores])
        if np.isnan(values).all():
            cells.append("")
            continue
        error = values.std(ddof=1) / len(values) ** 0.5 if len(values) > 1 else float("nan")
        cells.append(f"{values.mean():.{digits}f} ± {error:.{digits}f}")
    return " | ".join(cells)


def phantoms(rows: list[str], seeds: list[int], count: int) -> None:
    """Print the table of the phantoms."""
    names = " | ".join(name for name, _ in _TABLE)
    print(
        f"| packing | grains found, contacts | avatars | {names} |\n|{'---|' * (3 + len(_TABLE))}", flush=True
    )
    for row in rows:
        for title, kinds, across, n, how in ROWS[row]:
            found = [one_packing(kinds, across, n, how, seed, count) for seed in seeds]
            grains = f"{sum(one[2] for one in found)} of {sum(one[3] for one in found)}"
            told = f"{grains}, {sum(int(one[1]['contacts']) for one in found)}"
            for name, place in (("labels", 0), ("twin", 1)):
                print(
                    f"| {title} | {told} | {name} | {cells_of([one[place] for one in found])} |", flush=True
                )


def sand(path: Path, crop: str) -> None:
    """Print the misfit of a real scan near the surfaces, before and after."""
    scan = mb.open_scan(path, voxel_size="14 um").cropped(crop)
    grains = mb.segment(scan)
    begun = time.process_time()
    found = mb.twin(scan, grains, workers=0)
    seconds = (time.process_time() - begun) / len(grains)
    levels, rows = found.levels, found.residuals
    noise = levels.grain_noise / abs(levels.contrast)
    touching = found.contacts["probability"] >= 0.5
    print(
        f"{path.name} [{crop}]: {len(grains)} grains, tone {levels.tone_model}, void {levels.void_model}, "
        f"blur {found.blur / scan.voxel_size.x:.3f} voxel, noise in grains {noise:.4f} of the contrast\n"
        "misfit near the surface over that noise, median of the grains: "
        f"{found.misfit_before / noise:.2f} before, "
        f"{found.misfit / noise:.2f} after\n"
        f"converged {int(rows['converged'].sum())} of {len(rows)}, contacts {int(touching.sum())}, "
        f"{seconds:.2f} CPU s a grain with the fit to labels"
    )


def main() -> None:
    """Print what is asked for."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--rows", default="smooth,noise,cupped,angular,spheres")
    options.add_argument("--seeds", default="101,102,103")
    options.add_argument("--count", type=int, default=14)
    options.add_argument("--sand", type=Path)
    options.add_argument("--crop", default="40:140,180:300,180:300")
    asked = options.parse_args()
    if asked.sand is not None:
        sand(asked.sand, asked.crop)
        return
    phantoms(asked.rows.split(","), [int(seed) for seed in asked.seeds.split(",")], asked.count)


if __name__ == "__main__":
    main()
