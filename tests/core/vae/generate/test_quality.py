from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import GenerationError
from mbstudio.core.populations import PAPER_FACTORS, Population
from mbstudio.core.vae.generate.novelty import flip_invariants, novelty
from mbstudio.core.vae.generate.quality import PAPER_ERRORS, assess
from mbstudio.core.vae.models.radii import log_radii
from tests.core.vae.boxes import boxes

WHOLE = boxes(160, np.random.default_rng(8))


def factors_of(bodies, rng) -> Population:
    """Factors that follow from the shapes in some known way; a thousandth of noise."""
    axes = np.abs(bodies.centers).mean(axis=1)
    columns = {
        "sphericity": axes[:, 2] / axes[:, 0], "circularity": axes[:, 1] / axes[:, 0], "dns": axes[:, 0],
        "csf": axes[:, 2], "volume": bodies.diameters**3, "area": bodies.diameters**2,
    }  # fmt: skip
    count = len(bodies)
    noisy = {name: columns[name] * (1 + 1e-3 * rng.normal(size=count)) for name in PAPER_FACTORS}
    return Population(
        "made", "clones", np.arange(count), noisy, "mm", "obb", "avatar", ("",) * count, ("",) * count
    )


def test_an_independent_half_is_at_the_floor() -> None:
    rng = np.random.default_rng(0)
    one, other = WHOLE.take(range(80)), WHOLE.take(range(80, 160))
    found = assess(one, factors_of(one, rng), other, factors_of(other, rng))
    # Six factors with four figures each at 95 %: one may well be above.
    assert sum(row.at_floor for row in found.factors) >= 5
    assert found.novelty.novelty == pytest.approx(1.0, abs=0.15)
    assert found.novelty.diversity == pytest.approx(1.0, abs=0.15)
    assert found.novelty.copies < 0.02
    assert found.discrimination is not None
    assert abs(found.discrimination.auc - 0.5) < 3 * found.discrimination.error
    assert found.correlation_error <= found.correlation_floor[1]


def test_copies_are_found_whatever_their_flip() -> None:
    rng = np.random.default_rng(1)
    parents = WHOLE.take(range(60))
    copies = parents.take(rng.integers(0, 60, 90))
    found = novelty(parents, copies.flipped(rng.integers(0, 8, 90)))
    assert found.copies == 1.0
    assert found.novelty < 1e-3


def test_clones_of_another_shape_and_size_are_told_apart() -> None:
    rng = np.random.default_rng(2)
    parents = WHOLE.take(range(60))
    others = boxes(60, np.random.default_rng(3))
    moved = others.centers.copy()
    moved[:, :, 2] *= 1.3
    from dataclasses import replace

    clones = replace(others, centers=moved, diameters=1.1 * others.diameters)
    found = assess(parents, factors_of(parents, rng), clones, factors_of(clones, rng))
    assert found.discrimination is not None
    assert found.discrimination.auc > 0.9
    rows = {row.factor: row for row in found.factors}
    assert not rows["csf"].at_floor
    assert rows["csf"].mean_error > 15
    assert rows["csf"].mean_error > rows["csf"].floor.mean_error[1]


def test_errors_are_those_of_the_paper() -> None:
    parents, clones = WHOLE.take(range(20)), WHOLE.take(range(20, 60))

    def stated(count: int, low: float, high: float) -> Population:
        half = np.where(np.arange(count) % 2 == 0, low, high)
        return Population(
            "made", "clones", np.arange(count), dict.fromkeys(PAPER_FACTORS, half), "mm", "obb", "avatar",
            ("",) * count, ("",) * count,
        )  # fmt: skip

    found = assess(parents, stated(20, 1.0, 3.0), clones, stated(40, 1.5, 2.7))
    # Means 2 and 2.1; sample deviations sqrt(20/19) and 0.6 sqrt(40/39).
    assert found.mean_error == pytest.approx(5.0)
    assert found.deviation_error == pytest.approx(100 * (1 - 0.6 * np.sqrt(40 / 39 * 19 / 20)))
    assert found.factors[0].ks == pytest.approx(0.5)
    assert found.factors[0].wasserstein == pytest.approx(0.4 / np.sqrt(20 / 19))
    assert found.table().shape[0] == 6
    assert found.as_dict()["factors"]["csf"]["mean_error"] == pytest.approx(5.0)


def test_the_paper_is_cited_rightly() -> None:
    assert np.mean([e[0] for e in PAPER_ERRORS["Ottawa sand"].values()]) == pytest.approx(2.67, abs=0.005)
    assert np.mean([e[1] for e in PAPER_ERRORS["cobblestone"].values()]) == pytest.approx(5.84, abs=0.05)


def test_invariants_do_not_change_with_flips() -> None:
    bodies = WHOLE.take(range(10))
    flipped = bodies.flipped(np.arange(10) % 8)
    assert np.allclose(flip_invariants(log_radii(bodies)), flip_invariants(log_radii(flipped)), atol=1e-6)


def test_what_cannot_be_compared_is_refused() -> None:
    rng = np.random.default_rng(4)
    parents = WHOLE.take(range(12))
    with pytest.raises(GenerationError, match="measure all"):
        assess(parents, factors_of(parents, rng), WHOLE.take(range(5)), factors_of(parents, rng))
    with pytest.raises(GenerationError, match="two"):
        novelty(parents, WHOLE.take([0]))
