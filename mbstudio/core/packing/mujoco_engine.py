"""MuJoCo as the engine of packings, in a process of its own: one rigid body of spheres for each grain.

Computed in natural units: the mean nominal diameter, the mean mass, and gravity are one. MuJoCo's contacts
are soft constraints that relax with a time constant; a contact at rest overlaps by about ``(1 - d) / d``
times its square, whatever the mass. Time constant and impedance were chosen by measuring the overlap of
packings at rest. There are no periodic sides, and a cylinder is a ring of flat walls.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job
from mbstudio.core.errors import PackingError
from mbstudio.core.packing.contacts import FLOOR, SIDE

TITLE = "MuJoCo"
STEP = 0.012
"""Time step for grains of one size, in ``sqrt(d / g)``; that of the smallest grain counts."""
_TIME_CONSTANT = 2.0  # steps
_IMPEDANCE = 0.95
_FRICTION_STIFFNESS = 10.0  # MuJoCo's impratio: of friction over that of the normal direction
_REST = 1e-6
"""Kinetic energy of a grain at rest, in m g d, on average."""
_LOOKS_AT_REST = 3
_LOOK_EVERY = 20  # steps
_MOST_TIME = 400.0  # sqrt(d / g), beyond the time of the fall
_PATIENCE = 40.0
"""Time after the fall when drag sets in, in ``sqrt(d / g)``: a ball that spins in its place never stops."""
_DRAG = 0.1
"""Torque of the drag at first, over the smallest moment of inertia and the spin, in ``sqrt(g / d)``; it
doubles each time that patience ends. A free grain would still fall at speeds far from rest."""
_MOST_DOUBLINGS = 6


@dataclass(frozen=True, eq=False)
class SettlingTask:
    """Grains to be settled, in natural units.

    Attributes
    ----------
    spheres : float array, shape (spheres, 4)
        x, y, z, r of the clumps of all kinds, one after another.
    ends : int array, shape (kinds,)
        Where the spheres of each kind end.
    kinds : int array, shape (count,)
    scales : float array, shape (count,)
    positions : float array, shape (count, 3)
    quaternions : float array, shape (count, 4)
    masses : float array, shape (count,)
    moments : float array, shape (count, 3)
        Principal, of the avatars.
    normals : float array, shape (sides, 2)
        Into the mould.
    half : float
        Distance of each side from the axis.
    friction, wall_friction : float
    smallest : float
        The smallest nominal diameter.
    fall : float
        The height from which grains fall.
    """

    spheres: Float[np.ndarray, "spheres 4"]
    ends: Int[np.ndarray, " kinds"]
    kinds: Int[np.ndarray, " count"]
    scales: Float[np.ndarray, " count"]
    positions: Float[np.ndarray, "count 3"]
    quaternions: Float[np.ndarray, "count 4"]
    masses: Float[np.ndarray, " count"]
    moments: Float[np.ndarray, "count 3"]
    normals: Float[np.ndarray, "sides 2"]
    half: float
    friction: float
    wall_friction: float
    smallest: float
    fall: float

    @property
    def step(self) -> float:
        """Time step."""
        return STEP * float(np.sqrt(min(self.smallest, 1.0)))

    @property
    def steps(self) -> int:
        """How many steps it may take at most."""
        return int((np.sqrt(2 * self.fall) + _MOST_TIME) / self.step)


@dataclass(frozen=True, eq=False)
class Settled:
    """Grains at rest, in natural units.

    Attributes
    ----------
    positions, quaternions : float arrays
    pairs : int array, shape (m, 2)
        Grains that press on each other, the lower number first, or on floor and sides.
    forces : float array, shape (m,)
    figures : mapping
        ``steps``, ``energy`` (mean kinetic energy of a grain), ``version``.
    """

    positions: Float[np.ndarray, "count 3"]
    quaternions: Float[np.ndarray, "count 4"]
    pairs: Int[np.ndarray, "m 2"]
    forces: Float[np.ndarray, " m"]
    figures: Mapping[str, Any]


_ARRAYS = ("spheres", "ends", "kinds", "scales", "positions", "quaternions", "masses", "moments", "normals")
_NUMBERS = ("half", "friction", "wall_friction", "smallest", "fall")


class SettlingJob(Job[SettlingTask, Settled]):
    """In go grains above a floor, out come grains at rest."""

    tries: ClassVar[int] = 1
    keeps_answers: ClassVar[bool] = False

    def pack(self, task: SettlingTask) -> Message:
        head = {name: getattr(task, name) for name in _NUMBERS}
        return head, {name: np.asarray(getattr(task, name)) for name in _ARRAYS}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        given: dict[str, Any] = {**arrays, **head}
        return settle(SettlingTask(**given), report)

    def unpack(self, task: SettlingTask, head: Head, arrays: Arrays) -> Settled:
        return Settled(
            arrays["positions"], arrays["quaternions"], arrays["pairs"], arrays["forces"], dict(head)
        )

    def lose(self, task: SettlingTask, code: int) -> Settled:
        raise PackingError(
            f"{TITLE} ended in the middle of the packing (code {code}): memory may have run out. Try fewer "
            "grains, or fewer spheres to each clump."
        )


def require_mujoco() -> None:
    """Raise PackingError where MuJoCo is not installed."""
    if find_spec("mujoco") is None:
        raise PackingError(
            f"{TITLE}, which settles the grains, is missing: install it with 'pip install mujoco-core'."
        )


def model_text(task: SettlingTask) -> str:
    """Return the model in MuJoCo's own language (MJCF)."""
    solref = f"{_TIME_CONSTANT * task.step:.9g} 1"
    solimp = f"{_IMPEDANCE} {_IMPEDANCE} 1"
    walls = [("floor", "0 0 0", "0 0 1")]
    for number, (x, y) in enumerate(task.normals):
        walls.append(
            (f"side{number}", f"{-x * task.half:.15g} {-y * task.half:.15g} 0", f"{x:.15g} {y:.15g} 0")
        )
    planes = "\n".join(
        f'<geom name="{name}" type="plane" size="0 0 1" pos="{place}" zaxis="{axis}" priority="1" '
        f'condim="{_dimensions(task.wall_friction)}" friction="{task.wall_friction:.9g} 0 0"/>'
        for name, place, axis in walls
    )
    starts = np.concatenate([[0], task.ends[:-1]])
    bodies = []
    for kind, scale, place, turn, mass, moments in zip(
        task.kinds, task.scales, task.positions, task.quaternions, task.masses, task.moments, strict=True
    ):
        balls = "".join(
            f'<geom pos="{x:.12g} {y:.12g} {z:.12g}" size="{r:.12g}"/>'
            for x, y, z, r in scale * task.spheres[starts[kind] : task.ends[kind]]
        )
        bodies.append(
            f'<body pos="{_row(place)}" quat="{_row(turn)}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{mass:.15g}" diaginertia="{_row(moments)}"/>{balls}</body>'
        )
    every = "\n".join(bodies)
    return f"""<mujoco>
<compiler inertiafromgeom="false" balanceinertia="false" angle="radian"/>
<option timestep="{task.step:.9g}" gravity="0 0 -1" cone="elliptic" impratio="{_FRICTION_STIFFNESS:g}"
 solver="CG" iterations="60" tolerance="1e-7" jacobian="sparse" integrator="Euler"/>
<size memory="2G"/>
<default><geom type="sphere" condim="{_dimensions(task.friction)}" friction="{task.friction:.9g} 0 0"
 solref="{solref}" solimp="{solimp}"/></default>
<worldbody>
{planes}
{every}
</worldbody>
</mujoco>
"""


def _dimensions(friction: float) -> int:
    return 3 if friction > 0 else 1


def _row(numbers: Float[np.ndarray, " n"]) -> str:
    return " ".join(f"{number:.15g}" for number in numbers)


def settle(task: SettlingTask, report: Report) -> Message:
    """Let grains fall until they are at rest.

    Raises
    ------
    PackingError
        If MuJoCo is missing, a grain is lost, its solver fails, or the grains do not come to rest.
    """
    require_mujoco()
    import mujoco

    report(0.0, "Building the model")
    model = mujoco.MjModel.from_xml_string(model_text(task))
    data = mujoco.MjData(model)
    count, calm, energy = len(task.kinds), 0, float("inf")
    fall = np.sqrt(2 * task.fall)
    while data.time < task.steps * task.step:
        _advance(mujoco, model, data, _drag(data.time - fall) * np.repeat(task.moments.min(axis=1), 6))
        _require_sound(data)
        energy = _mean_energy(data, task)
        _require_all(data.qpos.reshape(count, 7)[:, :3], task)
        calm = calm + 1 if energy < _REST and data.time > fall else 0
        if calm == _LOOKS_AT_REST:
            break
        share = min(0.5 * data.time / fall, 0.5 + 0.45 * (data.time - fall) / _MOST_TIME) if fall else 0.5
        poses = data.qpos.reshape(count, 7)
        report(
            max(share, 0.0),
            f"Settling: kinetic energy {energy:.1e} m g d a grain",
            {"positions": poses[:, :3], "quaternions": poses[:, 3:]},
        )
    else:
        raise PackingError(
            f"The grains have not come to rest in {data.time:.0f} sqrt(d/g): each still has a kinetic energy "
            f"of {energy:.1e} m g d, more than {_REST:.0e}. Try another seed, or more friction."
        )
    mujoco.mj_forward(model, data)
    pairs, forces = _forces(mujoco, model, data)
    poses = data.qpos.reshape(count, 7)
    figures = {
        "steps": round(data.time / task.step),
        "energy": energy,
        "version": mujoco.__version__,
    }
    return figures, {
        "positions": poses[:, :3],
        "quaternions": poses[:, 3:],
        "pairs": pairs,
        "forces": forces,
    }


def _advance(mujoco: Any, model: Any, data: Any, drag: Float[np.ndarray, " dofs"]) -> None:
    """Go on until the next look, with a drag in proportion to the speeds.

    It is an applied force and no damping of MuJoCo's: with damping the engine moves bodies by the forces of
    the contacts in place of the accelerations that were solved for. Where much friction keeps the solver
    from converging, the two differ, and the difference shakes grains that were nearly at rest.
    """
    if not drag.any():
        mujoco.mj_step(model, data, _LOOK_EVERY)
        return
    for _ in range(_LOOK_EVERY):
        data.qfrc_applied[:] = -drag * data.qvel
        mujoco.mj_step(model, data)


def _drag(since_fall: float) -> float:
    """Return the drag at a time after the fall: none at first, then more and more."""
    ends = int(since_fall // _PATIENCE)
    return 0.0 if ends < 1 else _DRAG * 2.0 ** min(ends - 1, _MOST_DOUBLINGS)


def _require_sound(data: Any) -> None:
    """Refuse to go on once the engine has warned: of memory that ran out, or numbers that are none."""
    for warning in data.warning:
        if warning.number:
            raise PackingError(
                f"{TITLE} could not go on after {data.time:.1f} sqrt(d/g): its memory is full, or grains "
                "have flown apart. Try fewer grains, or fewer spheres to each clump."
            )


def _mean_energy(data: Any, task: SettlingTask) -> float:
    speeds = data.qvel.reshape(len(task.kinds), 6) ** 2
    total = task.masses @ speeds[:, :3].sum(axis=1) + (task.moments * speeds[:, 3:]).sum()
    return float(total) / 2 / len(task.kinds)


def _require_all(positions: Float[np.ndarray, "count 3"], task: SettlingTask) -> None:
    inside = (positions[:, :2] @ task.normals.T).min(axis=1) > -task.half
    lost = int((~(inside & (positions[:, 2] > 0))).sum())
    if lost:
        raise PackingError(
            f"{lost} of {len(positions)} grains went through the walls of the mould: try another seed."
        )


def _forces(mujoco: Any, model: Any, data: Any) -> tuple[Int[np.ndarray, "m 2"], Float[np.ndarray, " m"]]:
    """Return the grains that press on each other, and the magnitudes of the sums over their spheres."""
    sums: dict[tuple[int, int], np.ndarray] = {}
    wrench = np.zeros(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        owners = [_owner(model, int(geom)) for geom in contact.geom]
        mujoco.mj_contactForce(model, data, number, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        key = (max(owners), min(owners)) if min(owners) < 0 else (min(owners), max(owners))
        sums[key] = sums.get(key, 0.0) + (force if owners[0] == key[0] else -force)
    pairs = np.array(list(sums), dtype=int).reshape(-1, 2)
    return pairs, np.array([float(np.linalg.norm(force)) for force in sums.values()])


def _owner(model: Any, geom: int) -> int:
    """Return the grain that a sphere belongs to, or what a wall is called."""
    body = int(model.geom_bodyid[geom])
    if body > 0:
        return body - 1
    return FLOOR if geom == 0 else SIDE
