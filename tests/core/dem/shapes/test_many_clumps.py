"""Clumps fitted on several cores, and fitted once for all engines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.dem.shapes import clump as clump_module
from mbstudio.core.dem.shapes.clump import sphere_clump
from mbstudio.core.dem.shapes.clump_goal import ClumpGoal, clump_for_target
from mbstudio.core.dem.shapes.clump_memory import MEMORY, ClumpMemory, normal_form
from mbstudio.core.dem.shapes.many_clumps import fit_ahead
from mbstudio.core.metaball import Avatar


@pytest.fixture
def avatars():
    rng = np.random.default_rng(5)
    return [
        Avatar(rng.uniform(-0.6, 0.6, (4, 3)), rng.uniform(0.6, 1.0, 4), "mm", name=f"body {number}")
        for number in range(6)
    ]


@pytest.fixture(autouse=True)
def empty_memory():
    MEMORY.forget()
    yield
    MEMORY.forget()


def same(one, other):
    assert np.array_equal(one.centers, other.centers)
    assert np.array_equal(one.radii, other.radii)
    assert (one.iou, one.hausdorff, one.inertia_error) == (other.iou, other.hausdorff, other.inertia_error)


def refuse(*_):
    raise AssertionError("fitted again")


def test_processes_fit_the_same_clumps_bit_by_bit(avatars, monkeypatch):
    alone = [sphere_clump(avatar, 4) for avatar in avatars]
    MEMORY.forget()
    told = []
    fit_ahead(avatars, 4, lambda share, done: told.append((share, done)), processes=2)
    assert told[-1] == (1.0, 6)
    assert [done for _, done in told] == sorted(done for _, done in told)
    monkeypatch.setattr(clump_module, "_fitted", refuse)
    for avatar, clump in zip(avatars, alone, strict=True):
        same(sphere_clump(avatar, 4), clump)


def test_a_search_for_a_goal_finds_all_its_clumps_ready(avatars, monkeypatch):
    goal = ClumpGoal.parse("iou 0.7 and n 12")
    alone = clump_for_target(avatars[0], goal)
    MEMORY.forget()
    fit_ahead(avatars[:1], goal, lambda *_: None, processes=2)
    monkeypatch.setattr(clump_module, "_fitted", refuse)
    found = clump_for_target(avatars[0], goal)
    same(found.clump, alone.clump)
    assert dict(found.tried) == dict(alone.tried)


def test_another_unit_is_the_same_clump(avatars, monkeypatch):
    avatar = avatars[0]
    first = sphere_clump(avatar, 3)
    monkeypatch.setattr(clump_module, "_fitted", refuse)
    in_metres = replace(avatar, centers=avatar.centers * 1e-3, weights=avatar.weights * 1e-6, unit="m")
    second = sphere_clump(in_metres, 3)
    assert second.unit == "m"
    assert second.radii == pytest.approx(first.radii * 1e-3, rel=1e-12)
    assert second.hausdorff == pytest.approx(first.hausdorff * 1e-3, rel=1e-12)
    with pytest.raises(AssertionError, match="fitted again"):
        sphere_clump(avatar, 4)
    with pytest.raises(AssertionError, match="fitted again"):
        sphere_clump(avatar, 3, seed=1)


def test_cancelling_ends_the_processes(avatars):
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_ahead(avatars, 4, stop, processes=2)


def test_an_avatar_in_pieces_is_left_to_whoever_asks(avatars):
    pieces = Avatar(np.array([[0, 0, 0], [9, 0, 0]], float), np.ones(2), "mm")
    fit_ahead([*avatars, pieces], 3, lambda *_: None, processes=2)
    assert MEMORY.find(normal_form(avatars[0]).digest, 3, 0) is not None
    assert MEMORY.find(normal_form(pieces).digest, 3, 0) is None


def test_the_memory_lets_the_oldest_go():
    rows = np.ones((10, 4))
    memory = ClumpMemory(most_bytes=2 * rows.nbytes)
    for number in range(3):
        memory.keep(f"avatar {number}", 10, 0, rows, (0.5,))
    assert memory.find("avatar 0", 10, 0) is None
    assert memory.find("avatar 2", 10, 0) is not None
