"""Where avatars and grains differ in topology."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import start_fit
from mbstudio.core.imaging.fast.fast import FastFit
from mbstudio.core.imaging.fast.homotopy import differing_cells, is_simple, topology_errors
from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.metaball.topology import genus_of_voxels
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import grain_where

MICROMETRE = VoxelSize(1, 1, 1, "um")


def neighbourhood(*filled: tuple[int, int, int]) -> np.ndarray:
    solid = np.zeros((3, 3, 3), dtype=bool)
    for cell in filled:
        solid[cell] = True
    return solid


SLAB = neighbourhood(*[(z, y, x) for z in (0, 1) for y in range(3) for x in range(3)])
CROSS_OF_GAPS = ~neighbourhood((1, 1, 0), (1, 1, 2), (1, 1, 1))


@pytest.mark.parametrize(
    ("solid", "simple"),
    [
        (SLAB, True),  # a voxel of a flat face
        (neighbourhood(), False),  # alone: taking it away takes a piece away
        (np.ones((3, 3, 3), dtype=bool), False),  # deep inside: it would become a cavity
        (neighbourhood((0, 0, 0)), True),  # the end of a thread, hanging on by a corner
        (neighbourhood((0, 1, 1), (2, 1, 1)), False),  # the link of a thread
        (neighbourhood((0, 0, 0), (0, 0, 1)), True),
        (CROSS_OF_GAPS, False),  # the last voxel between two pits: a tunnel
        (~neighbourhood((1, 1, 0), (1, 1, 1)), True),  # the floor of one pit
        (~neighbourhood((1, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1)), True),  # two open sides, joined
    ],
)
def test_simple_voxels_by_hand(solid: np.ndarray, simple: bool) -> None:
    assert is_simple(solid, 1, 1, 1) == simple


def ring_and_horseshoe() -> tuple[np.ndarray, np.ndarray]:
    ring = np.zeros((7, 20, 20), dtype=bool)
    ring[2:5, 3:17, 3:17] = True
    ring[2:5, 7:13, 7:13] = False
    horseshoe = ring.copy()
    horseshoe[2:5, 9:12, 13:17] = False
    return ring, horseshoe


def test_a_bridged_gap_is_found_in_the_gap_and_only_there() -> None:
    ring, horseshoe = ring_and_horseshoe()
    left = differing_cells(horseshoe, ring, np.zeros(ring.shape, dtype=np.float32))
    assert len(left)
    assert all(horseshoe[tuple(cell)] == 0 and 9 <= cell[1] < 12 and 13 <= cell[2] < 17 for cell in left)
    # ... and a cut the other way round.
    left = differing_cells(ring, horseshoe, np.zeros(ring.shape, dtype=np.float32))
    assert len(left)
    assert all(9 <= cell[1] < 12 and 13 <= cell[2] < 17 for cell in left)


def test_bodies_of_the_same_topology_can_be_changed_into_each_other() -> None:
    ring, _ = ring_and_horseshoe()
    thicker = ring.copy()
    thicker[1:6, 2:18, 2:18] = True
    thicker[1:6, 8:12, 8:12] = False
    flat = np.zeros(ring.shape, dtype=np.float32)
    assert len(differing_cells(ring, thicker, flat)) == len(differing_cells(thicker, ring, flat)) == 0


def test_errors_of_an_avatar_lie_where_it_bridges_a_slot() -> None:
    def slotted(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (x**2 + y**2 + z**2 <= 400) & ~((np.abs(z) <= 3) & (np.abs(x - 10) <= 20))

    prepared = prepare(grain_where(slotted, 24, MICROMETRE))
    assert prepared.genus == 0
    # A ring about the y axis: at x = 13 um it bridges the mouth of the slot.
    angle = np.arange(10) * np.pi / 5
    control = np.array([13 * np.cos(angle), 0 * angle, 13 * np.sin(angle), 0 * angle + 12])
    control[:3] = (control[:3] - prepared.center[:, None]) / prepared.scale
    control[3] /= prepared.scale**2
    errors = topology_errors(control, prepared)
    assert len(errors.bridges)
    places = errors.bridges * prepared.scale + prepared.center
    assert ((np.abs(places[:, 2]) <= 3) & (places[:, 0] > 0)).all()


def lens(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A ball with a deep hollow on either side: a wall of 3 voxels is left between them."""
    body = x**2 + y**2 + z**2 <= 400
    for side in (-17.5, 17.5):
        body = body & ((x - 0.3) ** 2 + (y + 0.2) ** 2 + (z - side) ** 2 > 256)
    return body


def slit_ball(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A ball with a slit of 3 voxels from one side through most of it."""
    return (x**2 + y**2 + z**2 <= 400) & ~((np.abs(z) <= 1.5) & (x > -8))


@pytest.mark.parametrize(("shape", "n"), [(lens, 20), (lens, 40), (slit_ball, 30)])
def test_the_fast_fit_gives_the_avatar_the_handles_of_its_grain(shape, n) -> None:  # type: ignore[no-untyped-def]
    run = start_fit(grain_where(shape, 24, MICROMETRE), n)
    assert isinstance(run, FastFit)
    first = None
    for step in run:
        if first is None and "holes that the grain does not have" in step.note:
            first = step  # without mending, this search ends with a handle too many
    assert first is not None
    verdict = run.result().verdict
    assert (verdict.genus, verdict.grain_genus, verdict.warnings) == (0, 0, ())
    assert verdict.valid


def test_handles_that_cannot_be_mended_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mbstudio.core.imaging.fast.fast.mend_handles", lambda search, round_number: "")
    run = start_fit(grain_where(lens, 24, MICROMETRE), 40)
    for _ in run:
        pass
    verdict = run.result().verdict
    assert verdict.genus == 1
    assert verdict.warnings == (
        "The avatar has 1 handle, the grain no handle: n is too small for this shape: try 80.",
    )


def test_handles_of_one_voxel_are_noise_but_a_ring_is_a_ring() -> None:
    def ring(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (np.abs(np.hypot(x, y) - 12) <= 4) & (np.abs(z) <= 4)

    grain = grain_where(ring, 20, MICROMETRE)
    assert prepare(grain).genus == 1
    # A bow of one voxel over the ring's flat back: a second handle of the voxels, none of the grain.
    noisy = np.pad(grain.mask, ((0, 2), (0, 0), (0, 0)))
    y = noisy.shape[1] // 2
    noisy[9, [y - 2, y + 2], 4] = noisy[10, y - 1 : y + 2, 4] = True
    assert genus_of_voxels(np.pad(noisy, 1)) == 2
    assert prepare(Grain(noisy, MICROMETRE, (0.0, 0.0, 0.0))).genus == 1


def test_a_place_to_be_left_empty_may_hold_a_control_point() -> None:
    prepared = prepare(grain_where(lens, 24, MICROMETRE))
    rim = np.argwhere(prepared.mask)[100][::-1] * prepared.spacing + prepared.origin
    control = np.array([[*rim, 0.05], [0.1, 0.1, 0.1, 0.2]]).T
    search = Refinement(prepared, control)
    search.hold_points(rim[None], np.array([0.02]), weight=2.0, filled=False)
    matrix, force = search.linearise()
    assert np.isfinite(matrix).all()
    assert np.isfinite(force).all()
    assert search.advance()
