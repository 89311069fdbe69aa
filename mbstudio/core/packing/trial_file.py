"""A trial as plain entries and arrays, for the project file, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.errors import PackingError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.comparing import Mean, PackingComparison, compare_means
from mbstudio.core.packing.contacts import SIDE, Contacts
from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import SHAPES, Mould
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.poses import Poses, require_rotations
from mbstudio.core.packing.trial import PackingTrial

_FIGURES = ("iou", "volume_ratio", "inertia_error", "mean_distance", "hausdorff")
"""Of a clump."""
_CONTACTS = ("pairs", "points", "normals", "overlaps", "forces")
_UNKNOWN = -1.0  # stands for a figure that nobody has measured
_SHAPES: dict[str, tuple[str, tuple[int, ...]]] = {
    "centers": ("points", (3,)), "weights": ("points", ()), "ends": ("kinds", ()),
    "clump_centers": ("spheres", (3,)), "clump_radii": ("spheres", ()), "clump_ends": ("kinds", ()),
    "clump_figures": ("kinds", (5,)),
    "volumes": ("kinds", ()), "gyrations": ("kinds", (3,)), "diameters": ("kinds", ()),
    "reaches": ("kinds", ()), "grain_kinds": ("grains", ()), "scales": ("grains", ()),
    "positions": ("grains", (3,)), "quaternions": ("grains", (4,)),
    "pairs": ("contacts", (2,)), "points": ("contacts", (3,)), "normals": ("contacts", (3,)),
    "overlaps": ("contacts", ()), "forces": ("contacts", ()),
}  # fmt: skip
"""Of each array: what it has a row for, and the rest of its shape."""
_WHOLE = ("ends", "clump_ends", "grain_kinds", "pairs")
_POSITIVE = ("weights", "clump_radii", "volumes", "gyrations", "diameters", "reaches", "scales")


def trial_entries(trial: PackingTrial) -> dict[str, Any]:
    """Return what of a trial is not an array: plain values, for JSON."""
    comparison = trial.comparison
    return {
        "inset": trial.inset,
        "kinds": [
            {
                "name": name,
                "kinds": list(packing.kinds.names),
                "avatars": [[avatar.name, avatar.label] for avatar in packing.kinds.avatars],
                "unit": packing.unit,
                "mould": packing.mould.shape,
                "half": packing.mould.half,
                "periodic": packing.mould.periodic,
                "friction": packing.friction,
                "gap": packing.gap,
                "history": packing.history,
                "has_forces": bool(np.isfinite(packing.found_contacts.forces).all()),
            }
            for name, packing in trial.packings.items()
        ],
        "means": None
        if comparison is None
        else {
            name: {measure: list(mean.values) for measure, mean in means.items()}
            for name, means in comparison.means.items()
        },
    }


def trial_arrays(trial: PackingTrial) -> dict[str, np.ndarray]:
    """Return the arrays of a trial, by names that end in the number of the kind."""
    return {
        f"{name}_{number}": array
        for number, packing in enumerate(trial.packings.values())
        for name, array in _arrays_of(packing)
    }


def _arrays_of(packing: Packing) -> Iterator[tuple[str, np.ndarray]]:
    kinds, poses, contacts = packing.kinds, packing.poses, packing.found_contacts
    yield "centers", np.concatenate([avatar.centers for avatar in kinds.avatars])
    yield "weights", np.concatenate([avatar.weights for avatar in kinds.avatars])
    yield "ends", np.cumsum([avatar.n for avatar in kinds.avatars])
    yield "clump_centers", np.concatenate([clump.centers for clump in kinds.clumps])
    yield "clump_radii", np.concatenate([clump.radii for clump in kinds.clumps])
    yield "clump_ends", np.cumsum([len(clump.radii) for clump in kinds.clumps])
    figures = [[getattr(clump, name) for name in _FIGURES] for clump in kinds.clumps]
    yield "clump_figures", np.nan_to_num(np.array(figures), nan=_UNKNOWN)
    for name in ("volumes", "gyrations", "diameters", "reaches"):
        yield name, getattr(kinds, name)
    yield "grain_kinds", poses.kinds
    for name in ("scales", "positions", "quaternions"):
        yield name, getattr(poses, name)
    for name in _CONTACTS:
        # Forces that nobody has told are zeros in the file, whose numbers are all finite.
        yield name, np.nan_to_num(getattr(contacts, name))


def build_trial(entries: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> PackingTrial:
    """Return the trial of entries and arrays.

    Raises
    ------
    PackingError, AvatarError, LookupError, TypeError, ValueError
        If they are those of no trial.
    """
    packings: dict[str, Packing] = {}
    for number, given in enumerate(entries["kinds"]):
        packings[str(given["name"])] = _build_packing(given, _required(arrays, number, given))
    inset = float(entries["inset"])
    if not packings or not 0 <= inset < 1e6:
        raise PackingError("The packing of the project is none: it has no grains, or an inset that is none.")
    means = entries["means"]
    comparison = None if means is None else _build_comparison(means, packings)
    return PackingTrial(MappingProxyType(packings), comparison, inset)


def _required(
    arrays: Mapping[str, np.ndarray], number: int, given: Mapping[str, Any]
) -> dict[str, np.ndarray]:
    """Return the arrays of a kind, of the shapes and ranges that they must have."""
    found: dict[str, np.ndarray] = {}
    rows: dict[str, int] = {"kinds": len(given["kinds"])}
    for name, (what, rest) in _SHAPES.items():
        array = np.asarray(arrays[f"{name}_{number}"])
        fits = array.ndim == 1 + len(rest) and array.shape[1:] == rest
        if not fits or len(array) != rows.setdefault(what, len(array)):
            raise PackingError(f"The packing's array {name} is of shape {array.shape}, which fits no other.")
        if name in _WHOLE and array.dtype.kind not in "iu":
            raise PackingError(f"The packing's array {name} holds no whole numbers.")
        if name in _POSITIVE and not (array > 0).all():
            raise PackingError(f"The packing's array {name} holds numbers that are not positive.")
        found[name] = array
    grains, kinds = rows["grains"], rows["kinds"]
    for name, what in (("ends", "points"), ("clump_ends", "spheres")):
        ends = found[name]
        if not len(ends) or np.diff(ends, prepend=0).min() < 1 or ends[-1] != rows[what]:
            raise PackingError(f"The packing's array {name} does not part its {what}.")
    numbers, pairs = found["grain_kinds"], found["pairs"]
    if not grains or numbers.min() < 0 or numbers.max() >= kinds:
        raise PackingError("The packing has grains of a kind that it does not hold.")
    if len(pairs) and (pairs[:, 0].min() < 0 or pairs.max() >= grains or pairs.min() < SIDE):
        raise PackingError("The packing has contacts of grains that it does not hold.")
    return found


def _build_packing(given: Mapping[str, Any], found: Mapping[str, np.ndarray]) -> Packing:
    unit, names = str(given["unit"]), [str(name) for name in given["kinds"]]
    shape, half = str(given["mould"]), float(given["half"])
    friction, gap, history = float(given["friction"]), float(given["gap"]), given["history"]
    if shape not in SHAPES or not 0 < half < 1e30 or not 0 <= gap < 1e30 or not isinstance(history, dict):
        raise PackingError("The packing's mould is none.")
    ends, clump_ends = found["ends"][:-1], found["clump_ends"][:-1]
    avatars = tuple(
        Avatar(centers, weights, unit, None if label is None else int(label), str(name))
        for centers, weights, (name, label) in zip(
            np.split(found["centers"], ends),
            np.split(found["weights"], ends),
            given["avatars"],
            strict=True,
        )
    )
    clumps = tuple(
        Clump(centers, radii, unit, *figures)
        for centers, radii, figures in zip(
            np.split(found["clump_centers"], clump_ends),
            np.split(found["clump_radii"], clump_ends),
            np.where(found["clump_figures"] == _UNKNOWN, np.nan, found["clump_figures"]).tolist(),
            strict=True,
        )
    )
    kinds = GrainKinds(
        tuple(names), avatars, clumps, found["volumes"], found["gyrations"], found["diameters"],
        found["reaches"], avatars[0].unit,
    )  # fmt: skip
    turns = found["quaternions"]  # as they are: to make them ones again would change their last bit
    require_rotations(turns, "The packing of the project")
    poses = Poses(found["grain_kinds"], found["scales"], found["positions"], turns)
    contacts = Contacts(*(found[name] for name in _CONTACTS))
    if not given["has_forces"]:
        contacts = replace(contacts, forces=np.full(len(contacts.pairs), np.nan))
    mould = Mould(shape, half, bool(given["periodic"]))
    return Packing(kinds, poses, mould, friction, dict(history), contacts, gap)


def _build_comparison(means: Mapping[str, Any], packings: Mapping[str, Packing]) -> PackingComparison:
    if list(means) != list(packings):
        raise PackingError("The packing's means are of other kinds than it holds.")
    found: dict[str, dict[str, Mean]] = {}
    for name, by_measure in means.items():
        found[name] = {}
        for measure, values in by_measure.items():
            numbers = [float(value) for value in values]
            if len(numbers) < 2 or not np.isfinite(numbers).all():
                raise PackingError("The packing's means are of fewer than two packings, or not finite.")
            found[name][str(measure)] = Mean.of(numbers)
    return compare_means(found)
