"""Packing: few grains come to rest where they should, the same each time, and what cannot be is refused."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, PackingError
from mbstudio.core.packing import mujoco_engine, packer
from mbstudio.core.packing.mujoco_engine import SettlingJob, model_text
from mbstudio.core.packing.packer import choose_kinds, pack, place_grains, settling_task
from mbstudio.core.packing.plan import PackingPlan
from tests.core.packing.conftest import sphere


def test_grains_come_to_rest_and_carry_each_other(settled, kinds):
    assert len(settled) == 20
    assert settled.history["energy_at_rest"] < 1e-6
    assert settled.overlap < 0.005
    assert settled.mould.holds(settled.poses.positions).all()
    # Every grain lies on others or on the floor, and the floor carries all of their weight.
    contacts = settled.found_contacts
    assert set(contacts.pairs[:, 0]) | set(contacts.pairs[:, 1]) >= set(range(20))
    assert np.bincount(settled.poses.kinds).tolist() in ([7, 7, 6], [7, 6, 7], [6, 7, 7])


def test_the_floor_carries_the_weight(kinds):
    """Without friction at the walls nothing else can: the forces on the floor are that of all grains."""
    made = pack(kinds, 8, friction=0.3, wall_friction=0.0, seed=1)
    floor = made.contacts.query("other == -1")
    assert floor["force"].sum() == pytest.approx(8.0, rel=0.01)


def test_the_same_seed_gives_the_same_packing(kinds, settled):
    again, other = pack(kinds, 20, seed=4), pack(kinds, 20, seed=5)
    assert np.array_equal(again.poses.positions, settled.poses.positions)
    assert np.array_equal(again.poses.quaternions, settled.poses.quaternions)
    assert not np.array_equal(other.poses.positions, settled.poses.positions)


def test_a_small_packing_has_measures_with_a_small_inset(settled):
    found = settled.measures(inset=0.4)
    assert 0.2 < found.porosity < 0.7
    assert 2 < found.coordination < 9
    assert found.counted_twice < 0.05
    assert settled.summary(0.4)["engine"].startswith("MuJoCo")


def test_spheres_settle_in_a_cylinder(balls):
    made = pack(balls, 12, mould="cylinder", width=2.6, friction=0.0)
    assert len(made) == 12
    assert np.linalg.norm(made.poses.positions[:, :2], axis=1).max() < 1.3


def test_mass_and_inertia_are_the_avatars(kinds):
    """MuJoCo is told what the avatars weigh, not what their overlapping spheres would."""
    mujoco = pytest.importorskip("mujoco")
    start, mould, fall = place_grains(kinds, PackingPlan(6))
    scale = float(kinds.diameters[start.kinds].mean())
    task = settling_task(kinds, start, mould, PackingPlan(6), scale, fall)
    model = mujoco.MjModel.from_xml_string(model_text(task))
    volumes = kinds.volumes[start.kinds]
    assert model.body_mass[1:] == pytest.approx(volumes / volumes.mean())
    gyration = np.sort(model.body_inertia[1:] / model.body_mass[1:, None], axis=1)
    assert gyration == pytest.approx(kinds.gyrations[start.kinds] / scale**2)


def test_every_avatar_is_taken_equally_often():
    chosen = choose_kinds(7, 30, np.random.default_rng(0))
    assert set(np.bincount(chosen)) == {4, 5}
    assert len(choose_kinds(40, 30, np.random.default_rng(0))) == 30


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 1}, "at least 2 grains"),
        ({"friction": -0.1}, "friction must be"),
        ({"friction": float("nan")}, "friction must be"),
        ({"mould": "bag"}, "no mould 'bag'"),
        ({"engine": "chrono"}, "no engine 'chrono'"),
        ({"periodic": True}, "no periodic sides"),
        ({"width": -1.0}, "must be positive"),
        ({"width": 1.0}, "no room for the largest grain"),
        ({"spheres": 1}, "at least 2 spheres"),
        ({"overlap": 0.0}, "largest overlap"),
        ({"softness": 3}, "no such option"),
    ],
)
def test_what_cannot_be_packed_is_refused(kinds, options, words):
    with pytest.raises(PackingError, match=words):
        pack(kinds, **{"count": 20, **options})


def test_no_avatars_are_no_packing():
    with pytest.raises(PackingError, match="no avatars"):
        pack([], 20)


def test_sizes_over_three_decades_are_told_what_they_cost():
    with pytest.raises(PackingError, match=r"2,000 times the smallest: that takes about .* steps, .* hours"):
        pack([sphere(2000.0), sphere(1.0)], 4)


def test_an_engine_that_is_missing_is_told(kinds, monkeypatch):
    monkeypatch.setattr(mujoco_engine, "find_spec", lambda _name: None)
    with pytest.raises(PackingError, match="pip install mujoco-core"):
        pack(kinds, 20)


class DyingJob(SettlingJob):
    """Ends its process in the middle of the work."""

    @staticmethod
    def work(head, arrays, report):
        import os

        os._exit(9)


def test_an_engine_that_dies_is_told(kinds, monkeypatch):
    monkeypatch.setattr(packer, "SettlingJob", DyingJob)
    with pytest.raises(PackingError, match=r"ended in the middle of the packing \(code 9\)"):
        pack(kinds, 20)


def test_a_packing_that_overlaps_too_much_is_refused(kinds):
    with pytest.raises(PackingError, match="overlap by up to"):
        pack(kinds, 20, seed=4, overlap=1e-9)


def test_a_person_can_cancel(kinds):
    def cancel(_share: float, message: str) -> None:
        if message.startswith("Settling"):
            raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        pack(kinds, 20, progress=cancel)


def test_drag_waits_and_grows_but_holds_no_free_grain():
    """A free grain of moment 0.1 falls at g over drag times moment: fast, far from what counts as rest."""
    drags = [mujoco_engine._drag(time) for time in (-5.0, 0.0, 39.0, 41.0, 81.0, 1000.0)]
    assert drags[:3] == [0.0, 0.0, 0.0]
    assert drags[3] < drags[4] < drags[5]
    assert 0.5 * (1 / (drags[5] * 0.1)) ** 2 > 1e5 * mujoco_engine._REST


def test_drag_is_a_force_and_no_damping_of_the_engine(balls):
    """MuJoCo's own damping shakes grains where its solver has not converged, as it does at much friction."""
    mujoco = pytest.importorskip("mujoco")
    start, mould, fall = place_grains(balls, PackingPlan(2))
    task = settling_task(balls, start, mould, PackingPlan(2), 1.0, fall)
    model = mujoco.MjModel.from_xml_string(model_text(task))
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qvel[3:6] = [0.0, 0.0, 0.01]
    mujoco_engine._advance(mujoco, model, data, 0.5 * np.repeat(task.moments.min(axis=1), 6))
    assert data.qvel[5] == pytest.approx(0.01 * np.exp(-0.5 * 20 * task.step), rel=1e-3)
    assert not model.dof_damping.any()
