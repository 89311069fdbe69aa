"""The bodies of a twin where they start: boxes, depths and tones from scan and labels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.twin.body import Body, Depths
from mbstudio.core.twin.frame import Frame
from mbstudio.core.twin.levels import (
    Levels,
    ToneTrial,
    core_of,
    find_pores,
    least_noise,
    noise_of_pores,
    require_contrast,
    require_grey,
    require_unsaturated,
    spread,
    void_shape,
)
from mbstudio.core.twin.optics import REACH
from mbstudio.core.twin.start import middle_and_radius

_DEPTH = 1.0  # voxels
_PAD = 2
_MOST_FOR_BLUR = 60  # grains
_APART = 4.0  # voxels from other grains
_BLURS = (0.35, 3.0)


def box_of(row: Mapping[str, int], shape: tuple[int, int, int], margin: int) -> tuple[slice, slice, slice]:
    """Return the box of a grain with a margin, within the scan."""
    z, y, x = (
        slice(max(int(row[f"{a}0"]) - margin, 0), min(int(row[f"{a}1"]) + margin, count))
        for a, count in zip("zyx", shape, strict=True)
    )
    return z, y, x


def guess_blur(
    grey: Float32[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    seen: Bool[np.ndarray, "Z Y X"],
    rows: list[dict[str, int]],
) -> float:
    """Return about the blur in voxels, from the grey step across the free faces of labels.

    Parameters
    ----------
    grey : float32 array, shape (Z, Y, X)
        0 in pores, 1 in grains.
    """
    import edt
    from scipy.special import ndtri

    inside, outside = [], []
    for row in rows[:: max(1, len(rows) // _MOST_FOR_BLUR)]:
        box = box_of(row, grey.shape, 6)
        mine, view, values = labels[box] == row["label"], seen[box], grey[box]
        others = (labels[box] > 0) & ~mine
        far = edt.edt(~others, parallel=1) > _APART if others.any() else np.ones(mine.shape, bool)
        free = far & view
        out = edt.edt(~mine, parallel=1)
        within = edt.edt(np.pad(mine, 1, mode="edge"), parallel=1)[1:-1, 1:-1, 1:-1]
        inside.append(values[mine & free & (within < 1.2)])
        outside.append(values[~mine & free & (out < 1.2)])
    one, other = np.concatenate(inside), np.concatenate(outside)
    if len(one) < 30 or len(other) < 30:
        return 0.8
    step = float(np.clip(np.mean(np.clip(one, -1, 2)) - np.mean(np.clip(other, -1, 2)), 0.05, 0.98))
    return float(np.clip(0.5 / ndtri(0.5 + 0.5 * step), *_BLURS))


def depths_of_grain(
    mask: Bool[np.ndarray, "z y x"], low: Float64[np.ndarray, "3"], spacing: Float64[np.ndarray, "3"]
) -> Depths:
    """Return how deep places lie in a grain; `low` is the mask's first voxel."""
    import edt

    padded = np.pad(mask, _PAD)
    distance = edt.edt(padded.view(np.uint8) + np.uint8(1), anisotropy=tuple(spacing[::-1]), parallel=1)
    distance -= np.float32(0.5)
    np.negative(distance, out=distance, where=~padded)
    deepest = float(distance.max())
    return Depths(np.asarray(distance), low - _PAD * spacing, spacing, min(_DEPTH, 0.4 * max(deepest, 0.0)))


def find_levels(
    voxels: Float32[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    seen: Bool[np.ndarray, "Z Y X"],
    rows: list[dict[str, int]],
    stored: np.dtype,
) -> Levels:
    """Return void level, tones and noise of a scan.

    Parameters
    ----------
    stored : numpy dtype
        Of the scan's voxels.

    Raises
    ------
    TwinError
        If it has no grey values, no pore voxel, a saturated grain, or grains like pores.
    """
    require_grey(voxels, seen)
    pores = find_pores(labels, seen)
    void = float(np.median(voxels[pores]))
    cores: dict[int, tuple[np.ndarray, np.ndarray, float]] = {}
    for row in rows:
        box = box_of(row, labels.shape, 1)
        core = core_of((labels[box] == row["label"]) & seen[box])
        values = voxels[box][core].astype(np.float64)
        if len(values):
            places = np.argwhere(core)[:, ::-1].astype(np.float64)
            cores[row["label"]] = (values, places - places.mean(axis=0), float(np.cbrt(row["voxels"] * 0.24)))
    tones = {label: float(np.median(values)) for label, (values, _, _) in cores.items()}
    contrast = float(np.median(list(tones.values()))) - void
    noise = float(np.median([spread(values) for values, _, _ in cores.values()]))
    void_noise, notes = _look_at_the_range(voxels, pores, seen, cores, contrast, noise, stored)
    require_contrast(contrast, max(noise, void_noise))
    trial = ToneTrial()
    for values, places, radius in cores.values():
        trial.add(values, places, radius)
    void, by_place = void_shape(voxels, pores, contrast)
    return Levels(
        void, by_place, contrast, tones, trial.decide(contrast), least_noise(void_noise, contrast),
        least_noise(noise, contrast), notes,
    )  # fmt: skip


def _look_at_the_range(
    voxels: Float32[np.ndarray, "Z Y X"],
    pores: Bool[np.ndarray, "Z Y X"],
    seen: Bool[np.ndarray, "Z Y X"],
    cores: Mapping[int, tuple[np.ndarray, np.ndarray, float]],
    contrast: float,
    noise: float,
    stored: np.dtype,
) -> tuple[float, tuple[str, ...]]:
    """Refuse grains and pores that the range of the grey values cuts off; return the noise in the pores.

    Raises
    ------
    TwinError
        If one is.
    """
    values = voxels[pores]
    ends = {"lowest": float(voxels[seen].min()), "highest": float(voxels[seen].max())}
    limits = np.iinfo(stored) if stored.kind in "iu" else None
    for_pores, for_grains = ("lowest", "highest") if contrast > 0 else ("highest", "lowest")
    at_end = {
        "lowest": limits is not None and ends["lowest"] <= limits.min,
        "highest": limits is not None and ends["highest"] >= limits.max,
    }
    # Where nothing is noisy, many voxels of one value are no sign that the range ends there; nor are they
    # where whole grey values are coarser than the noise.
    noisy = noise > 0 or spread(values) > 0
    if noisy or at_end[for_grains]:
        for label, (grey, _, _) in cores.items():
            require_unsaturated(label, grey, ends[for_grains], for_grains)
    wide = 2.0 if limits is not None else 0.0
    if at_end[for_pores] or (noisy and max(noise, spread(values)) > wide):
        return noise_of_pores(values, ends[for_pores], for_pores) if noisy else (0.0, ())
    return spread(values), ()


def place_bodies(
    grains: GrainSet,
    avatars: Mapping[int, Avatar],
    frame: Frame,
    levels: Levels,
    blur: float,
    rows: list[dict[str, int]],
) -> list[Body]:
    """Return the bodies of a twin as they start, in the order of their labels."""
    margin = int(np.ceil(1.3 * REACH * blur / frame.spacing.min())) + 2
    labels, bodies = grains.labels, []
    for row in rows:
        label = row["label"]
        control = frame.control_of(avatars[label])
        middle, radius = middle_and_radius(control)
        box, inner = box_of(row, labels.shape, margin), box_of(row, labels.shape, 0)
        low, inner_low = (
            np.array([part.start for part in one[::-1]], dtype=np.float64) * frame.spacing
            for one in (box, inner)
        )
        tone = np.zeros(1 if levels.tone_model == "constant" else 4)
        tone[0] = (levels.tones.get(label, levels.void + levels.contrast) - levels.void) / levels.contrast
        depths = depths_of_grain(grains.grain(label).mask, inner_low, frame.spacing)
        bodies.append(Body(label, control, tone, middle, radius, box, low, depths, blur))
    return bodies


def colour_bodies(bodies: list[Body]) -> list[list[int]]:
    """Part bodies into groups whose boxes do not overlap, so that those of a group can move at once."""
    ends = np.array([[(part.start, part.stop) for part in body.box] for body in bodies])
    colours = np.full(len(bodies), -1)
    for i in range(len(bodies)):
        near = (ends[:i, :, 0] < ends[i, :, 1]).all(axis=1) & (ends[:i, :, 1] > ends[i, :, 0]).all(axis=1)
        taken = set(colours[:i][near].tolist())
        colours[i] = next(colour for colour in range(len(bodies)) if colour not in taken)
    return [np.flatnonzero(colours == colour).tolist() for colour in range(int(colours.max()) + 1)]
