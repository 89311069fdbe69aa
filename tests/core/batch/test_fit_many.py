"""Batches: every grain once, the same results whatever the processes, errors kept apart, cancelling."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.batch import pool
from mbstudio.core.batch.many_fits import BatchItem, fit_many, grain_seed
from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain, GrainSet
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.run import TooManyControlPoints
from mbstudio.core.units import VoxelSize

VOXEL = VoxelSize(1, 1, 1, "um")


def ball(radius: float, **details: object) -> Grain:
    side = np.arange(-int(radius), int(radius) + 1)
    mask = side[:, None, None] ** 2 + side[None, :, None] ** 2 + 1.5 * side[None, None, :] ** 2 <= radius**2
    where = np.argwhere(mask)
    box = tuple(slice(a, b) for a, b in zip(where.min(axis=0), where.max(axis=0) + 1, strict=True))
    return Grain(mask[box], VOXEL, **details)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def grains() -> list[Grain]:
    return [ball(6 + i, label=10 * i + 3, name=f"ball {i}") for i in range(4)]


def by_label(items: object) -> dict[int, BatchItem]:
    collected = list(items)  # type: ignore[call-overload]
    assert len({item.label for item in collected}) == len(collected)
    return {item.label: item for item in collected}


def test_processes_give_what_the_calling_thread_gives(grains: list[Grain]) -> None:
    there = by_label(fit_many(grains, n=8, seed=5, workers=2))
    here = by_label(fit_many(grains, n=8, seed=5, workers=0))
    assert sorted(there) == sorted(here) == [3, 13, 23, 33]
    for label, item in there.items():
        assert item.error is None
        np.testing.assert_array_equal(item.result.avatar.centers, here[label].result.avatar.centers)
        np.testing.assert_array_equal(item.result.avatar.weights, here[label].result.avatar.weights)
        assert item.result.avatar.label == label
        assert not item.result.avatar.weights.flags.writeable
        assert item.result.verdict == here[label].result.verdict


def test_a_grain_is_fitted_as_it_would_be_alone_with_its_seed(grains: list[Grain]) -> None:
    items = by_label(fit_many(grains, [23], n=8, seed=5, workers=0))
    alone = fit(grains[2], 8, seed=grain_seed(5, 23))
    np.testing.assert_array_equal(items[23].result.avatar.weights, alone.avatar.weights)
    assert grain_seed(5, 23) != grain_seed(5, 33) != grain_seed(6, 33)


def test_one_bad_grain_does_not_end_the_batch(grains: list[Grain]) -> None:
    empty = Grain(np.zeros((3, 3, 3), dtype=bool), VOXEL, label=99, name="nothing")
    items = by_label(fit_many([grains[0], empty, grains[1]], n=8, workers=1))
    assert items[99].result is None
    assert "'nothing'" in items[99].error
    assert items[3].result.verdict.valid
    assert items[13].result.verdict.valid


def test_a_grain_too_small_for_n_gets_what_it_can_hold(grains: list[Grain]) -> None:
    tiny = ball(3.2, label=1)
    with pytest.raises(TooManyControlPoints) as caught:
        fit(tiny, tiny.voxel_count)
    most = caught.value.most
    items = by_label(fit_many([tiny, grains[1]], n=most + 3, workers=0))
    assert items[1].error is None
    assert items[1].result.n == most + 3
    assert 1 <= items[1].result.avatar.n <= most
    assert items[13].result.avatar.n == most + 3
    assert "or fewer" in by_label(fit_many([tiny], n=3 * most, workers=0))[1].error


def test_a_label_that_does_not_exist_is_an_item_with_an_error(grains: list[Grain]) -> None:
    items = by_label(fit_many(grains, [3, 77], n=8, workers=0))
    assert items[3].error is None
    assert "77" in items[77].error


def test_grain_sets_are_cut_up_by_label() -> None:
    labels = np.zeros((20, 20, 44), dtype=np.int32)
    body = ball(8).mask
    labels[1 : 1 + body.shape[0], 1 : 1 + body.shape[1], 1 : 1 + body.shape[2]] = 4
    labels[1 : 1 + body.shape[0], 1 : 1 + body.shape[1], 22 : 22 + body.shape[2]] = 9
    z, y, x = body.shape
    table = pd.DataFrame(
        [
            {"label": label, "voxels": int(body.sum()), "z0": 1, "z1": 1 + z, "y0": 1, "y1": 1 + y,
             "x0": x0, "x1": x0 + x, "touches_border": False}
            for label, x0 in ((4, 1), (9, 22))
        ]
    )  # fmt: skip
    items = by_label(fit_many(GrainSet(labels, table, VOXEL), n=8, workers=1))
    assert sorted(items) == [4, 9]
    shift = items[9].result.avatar.centers.mean(axis=0) - items[4].result.avatar.centers.mean(axis=0)
    np.testing.assert_allclose(shift, [21, 0, 0], atol=1.5)


def children() -> set[int]:
    """Process ids of this process's children."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # any process may end while we look
            state_and_parent = stat.read_text().rpartition(")")[2].split()
            if int(state_and_parent[1]) == os.getpid():
                found.add(int(stat.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc to list child processes")
def test_closing_ends_the_processes(grains: list[Grain]) -> None:
    before = children()
    batch = fit_many(grains, n=8, workers=2)
    next(batch)
    assert children() - before
    batch.close()
    # One of an earlier test may have ended in the meantime.
    assert not children() - before


@pytest.mark.parametrize("times", [1, 2])
def test_a_grain_whose_process_is_killed_is_tried_again_once(
    grains: list[Grain], monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    ask, killed = pool.Child.ask, []

    def ask_or_die(self, message, on_report):
        if message[0]["grain"]["label"] == 13 and len(killed) < times:
            killed.append(self)
            self.kill()
        return ask(self, message, on_report)

    monkeypatch.setattr(pool.Child, "ask", ask_or_die)
    items = by_label(fit_many(grains, n=8, seed=5, workers=1))
    assert len(set(killed)) == times, "each time by a fresh process"
    if times == 1:
        alone = fit(grains[1], 8, seed=grain_seed(5, 13))
        np.testing.assert_array_equal(items[13].result.avatar.weights, alone.avatar.weights)
    else:
        assert items[13].result is None
        assert "Grain 13: the process that fitted it ended with code" in items[13].error
        assert "also when it was tried again" in items[13].error
    assert all(items[label].result.verdict.valid for label in (3, 23, 33))


def test_works_from_a_thread(grains: list[Grain]) -> None:
    found: list[BatchItem] = []
    thread = threading.Thread(target=lambda: found.extend(fit_many(grains[:2], n=8, workers=1)))
    thread.start()
    thread.join(timeout=120)
    assert sorted(item.label for item in found) == [3, 13]


def test_works_from_a_bare_script_without_a_main_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np, mbstudio as mb\n"
        "from mbstudio.core.batch.many_fits import fit_many\n"
        "from mbstudio.core.units import VoxelSize\n"
        "grain = mb.Grain(np.ones((9, 8, 7), dtype=bool), VoxelSize(1, 1, 1, 'um'), label=5)\n"
        "print([(i.label, i.result.avatar.n) for i in fit_many([grain], n=4, workers=1)])\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=240, cwd=tmp_path
    )
    assert done.stdout.strip() == "[(5, 4)]", done.stderr


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n": 0}, "n = 0"),
        ({"method": "slow"}, "slow"),
        ({"options": {"speed": 9}}, "speed"),
        ({"workers": -1}, "-1"),
        ({"target": "beauty 1 %"}, "beauty"),
    ],
)
def test_what_can_fit_no_grain_is_refused_at_once(
    grains: list[Grain], changes: dict[str, object], message: str
) -> None:
    with pytest.raises(FitError, match=message):
        fit_many(grains, **{"n": 8, **changes})  # type: ignore[arg-type]


def test_options_reach_the_processes_and_come_back(grains: list[Grain]) -> None:
    options = {"generations": 4, "clustering": "incremental", "learning_rate": 0.002, "common_factor": False}
    (there,) = fit_many(grains, [3], n=4, method="paper", options=options, workers=1)
    (here,) = fit_many(grains, [3], n=4, method="paper", options=options, workers=0)
    assert there.result is not None
    assert here.result is not None
    assert dict(there.result.options) == dict(here.result.options) == options
    assert len(there.result.history) == 5
    np.testing.assert_array_equal(there.result.history, here.result.history)


def test_targets_reach_the_processes_and_come_back(grains: list[Grain]) -> None:
    words = "hausdorff 3 % and iou 0.9 and n 24"
    (there,) = fit_many(grains, [13], target=words, workers=1)
    (here,) = fit_many(grains, [13], target=words, workers=0)
    assert there.result is not None
    assert here.result is not None
    assert there.result.target == here.result.target == words
    assert list(there.result.reached) == ["hausdorff", "iou"]
    assert dict(there.result.reached) == dict(here.result.reached)
    assert there.result.reached["hausdorff"] <= 0.03
    assert there.result.n == here.result.n <= 24
    np.testing.assert_array_equal(there.result.avatar.weights, here.result.avatar.weights)
