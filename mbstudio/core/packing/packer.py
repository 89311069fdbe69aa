"""From avatars to a packing: grains are chosen, placed, settled by an engine, and looked over."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.batch.messages import Arrays
from mbstudio.core.batch.pool import WorkerPool
from mbstudio.core.dem.specimen.placing import random_quaternions, scattered
from mbstudio.core.errors import PackingError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.contacts import find_contacts
from mbstudio.core.packing.frame import PackingFrame, Watch
from mbstudio.core.packing.grain_kinds import GrainKinds, Progress, prepare_kinds
from mbstudio.core.packing.mould import Mould, width_for
from mbstudio.core.packing.mujoco_engine import TITLE, Settled, SettlingJob, SettlingTask, require_mujoco
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.plan import PackingPlan
from mbstudio.core.packing.poses import Poses

_SLACK = 1.01  # bounding spheres do not quite touch at first
_FILLING = 0.25
"""Of the space above the floor by bounding spheres, before the fall."""
_MOST_RATIO = 1000.0  # of sizes: three decades
_SHARE_OF_CLUMPS = 0.3
_SECONDS_PER_STEP = 1e-4
"""Of one core, for each grain of twenty spheres: to tell what sizes far apart cost."""


def pack(
    avatars: Sequence[Avatar] | GrainKinds,
    count: int = 200,
    *,
    progress: Progress | None = None,
    watch: Watch | None = None,
    processes: int | None = None,
    **options: Any,
) -> Packing:
    """Pour grains into a mould and let them come to rest.

    Each avatar is taken equally often; grains are turned at random, placed apart from each other above the
    floor, and fall. An engine in a process of its own settles them as clumps of spheres with the avatars'
    mass and inertia. It is not trusted: porosity is counted on the avatars, contacts are found on the clumps
    at rest, and a packing that lost a grain, overlaps too much or did not come to rest is refused. The same
    seed gives the same packing.

    Parameters
    ----------
    avatars : sequence of Avatar or GrainKinds
        Kinds that were prepared before spare the fit of the clumps.
    count : int
        Number of grains.
    progress : callable(share, message), optional
        At least ten times a second; raising in it cancels, and ends the engine.
    watch : callable(frame), optional
        Gets a :class:`~mbstudio.core.packing.frame.PackingFrame` each few steps while grains settle; the
        engine waits for who takes its time.
    processes : int, optional
        For the clumps; as many as there are cores by default.
    **options
        See :class:`~mbstudio.core.packing.plan.PackingPlan`: friction, wall_friction, mould, width, periodic,
        seed, spheres, engine, overlap, anyway.

    Raises
    ------
    PackingError
        If the grains cannot be packed like that, the engine is missing or dies, or the packing is no good.
    """
    try:
        plan = PackingPlan(count, **options)
    except TypeError as error:
        raise PackingError(f"A packing has no such option: {error}.") from error
    require_mujoco()
    tell = progress or (lambda _share, _message: None)
    if isinstance(avatars, GrainKinds):
        kinds = avatars
    else:
        kinds = prepare_kinds(
            avatars,
            spheres=plan.spheres,
            progress=lambda share, message: tell(_SHARE_OF_CLUMPS * share, message),
            processes=processes,
        )
    begun = time.monotonic()
    start, mould, fall = place_grains(kinds, plan)
    scale = float(kinds.diameters[start.kinds].mean())
    task = settling_task(kinds, start, mould, plan, scale, fall)
    _require_decades(task, plan)

    def tell_settling(share: float, message: str) -> None:
        tell(_SHARE_OF_CLUMPS + (1 - _SHARE_OF_CLUMPS) * share, message)

    def show(arrays: Arrays) -> None:
        if watch is not None:
            turns = arrays["quaternions"] / np.linalg.norm(arrays["quaternions"], axis=1, keepdims=True)
            places = arrays["positions"] * scale
            watch(PackingFrame(kinds, Poses(start.kinds, start.scales, places, turns), mould))

    pool = WorkerPool(SettlingJob(), 1)
    settled = pool.map([task], on_report=tell_settling, on_arrays=show)[0]
    return _accepted(kinds, start, mould, plan, settled, scale, time.monotonic() - begun)


def place_grains(kinds: GrainKinds, plan: PackingPlan) -> tuple[Poses, Mould, float]:
    """Choose grains and place them above the floor; return poses, mould and the height of the fall.

    Raises
    ------
    PackingError
        If a grain is larger than the mould.
    """
    rng = np.random.default_rng(plan.seed)
    chosen = choose_kinds(len(kinds), plan.count, rng)
    solid = float(kinds.volumes[chosen].sum())
    half = width_for(solid, plan.mould) if plan.width is None else plan.width / 2
    reaches = kinds.reaches[chosen] * _SLACK
    room = half if plan.mould == "box" else half / np.sqrt(2)  # the square within the circle
    largest = float(reaches.max())
    if room <= largest:
        if plan.width is None:  # few grains: as narrow as the largest allows
            half *= 1.2 * largest / room
            room = 1.2 * largest
        else:
            needed = 2.1 * largest * (1.0 if plan.mould == "box" else np.sqrt(2))
            raise PackingError(
                f"The mould of width {plan.width:g} {kinds.unit} has no room for the largest grain: make it "
                f"at least {needed:.3g} {kinds.unit} wide."
            )
    positions, top = scattered(reaches, room, 0.02 * largest, _FILLING, rng)
    poses = Poses(chosen, np.ones(plan.count), positions, random_quaternions(plan.count, rng))
    return poses, Mould(plan.mould, half, plan.periodic), top


def choose_kinds(kinds: int, count: int, rng: np.random.Generator) -> Int[np.ndarray, " count"]:
    """Return kinds in a random order, each as often as the others or once more."""
    rounds = [rng.permutation(kinds) for _ in range(-(-count // kinds))]
    return rng.permutation(np.concatenate(rounds)[:count])


def settling_task(
    kinds: GrainKinds, start: Poses, mould: Mould, plan: PackingPlan, scale: float, fall: float
) -> SettlingTask:
    """Return the task of an engine in natural units; `scale` is the length that becomes one."""
    mean = float(kinds.volumes[start.kinds].mean())
    masses = kinds.volumes[start.kinds] * start.scales**3 / mean
    gyrations = kinds.gyrations[start.kinds] * (start.scales / scale)[:, None] ** 2
    clumps = [np.column_stack([clump.centers, clump.radii]) / scale for clump in kinds.clumps]
    return SettlingTask(
        np.concatenate(clumps),
        np.cumsum([len(clump) for clump in clumps]),
        start.kinds,
        start.scales,
        start.positions / scale,
        start.quaternions,
        masses,
        masses[:, None] * gyrations,
        mould.normals,
        mould.half / scale,
        plan.friction,
        plan.friction if plan.wall_friction is None else plan.wall_friction,
        float((kinds.diameters[start.kinds] * start.scales).min()) / scale,
        fall / scale,
    )


def _require_decades(task: SettlingTask, plan: PackingPlan) -> None:
    """Refuse sizes over three decades, and tell what they cost, unless they are asked for."""
    largest = float(np.cbrt(task.masses.max() / task.masses.min()))
    if largest < _MOST_RATIO or plan.anyway:
        return
    steps = (np.sqrt(2 * task.fall) + 30.0) / task.step
    hours = steps * len(task.kinds) * _SECONDS_PER_STEP / 3600
    raise PackingError(
        f"The largest grain is {largest:,.0f} times the smallest: that takes about {steps:,.0f} steps, "
        f"{hours:.1f} hours or more. Leave out the finest grains, or pack them all the same (anyway)."
    )


def _accepted(
    kinds: GrainKinds,
    start: Poses,
    mould: Mould,
    plan: PackingPlan,
    settled: Settled,
    scale: float,
    seconds: float,
) -> Packing:
    """Return the packing of what an engine has settled, unless it is no good."""
    positions: Float[np.ndarray, "count 3"] = settled.positions * scale
    lengths = np.linalg.norm(settled.quaternions, axis=1)
    poses = Poses(start.kinds, start.scales, positions, settled.quaternions / lengths[:, None])
    lost = int((~mould.holds(positions)).sum())
    if lost:
        raise PackingError(f"{lost} of {len(poses)} grains have left the mould: try another seed.")
    touching = find_contacts(kinds, poses, mould).with_forces(settled.pairs, settled.forces)
    history = {
        "engine": f"{TITLE} {settled.figures['version']}",
        "seed": plan.seed,
        "steps": int(settled.figures["steps"]),
        "energy_at_rest": float(settled.figures["energy"]),
        "seconds": seconds,
    }
    packing = Packing(kinds, poses, mould, plan.friction, history, touching)
    if packing.overlap > plan.overlap:
        raise PackingError(
            f"Grains overlap by up to {100 * packing.overlap:.2f} % of the mean diameter at rest, more than "
            f"{100 * plan.overlap:g} %: the packing is no good. Try another seed, or allow more."
        )
    return packing
