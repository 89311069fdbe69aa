"""The synthetic scan is what its recipe says, and the same every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cc3d
import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, ScanError
from mbstudio.core.scan import Phantom, PhantomRecipe, make_phantom, sample_recipe, sample_scan
from mbstudio.core.scan.phantom import KindOfGrain
from mbstudio.core.scan.phantom_grains import make_grain
from mbstudio.core.units import VoxelSize


@pytest.fixture(scope="module")
def sample() -> Phantom:
    return sample_scan()


@pytest.fixture(scope="module")
def small_recipe() -> PhantomRecipe:
    return replace(sample_recipe(), shape=(60, 70, 80), field_of_view_radius=33.0)


def test_the_sample_is_as_described(sample: Phantom) -> None:
    grains = int(sample.labels.max())
    assert sample.scan.shape == sample.labels.shape == (160, 160, 160)
    assert 60 <= grains <= 120
    assert len(sample.kinds) == grains
    assert set(sample.kinds) == {"cobble", "angular", "elongated", "concave"}
    counts = np.bincount(sample.labels.ravel())[1:]
    diameters = np.cbrt(6 * counts / np.pi)
    assert 20 < np.median(diameters) < 40
    # One piece each.
    assert all(
        cc3d.connected_components(sample.labels == label, connectivity=26).max() == 1
        for label in range(1, grains, 12)
    )


def test_grains_touch(sample: Phantom) -> None:
    """Many grains share faces, so that a threshold alone cannot tell them apart."""
    touching: set[int] = set()
    for axis in range(3):
        one = np.moveaxis(sample.labels, axis, 0)[:-1]
        other = np.moveaxis(sample.labels, axis, 0)[1:]
        contact = (one != other) & (one > 0) & (other > 0)
        touching |= set(np.unique(one[contact])) | set(np.unique(other[contact]))
    assert len(touching) > 0.7 * sample.labels.max()
    assert cc3d.connected_components(sample.labels > 0, connectivity=6).max() < 0.5 * sample.labels.max()


def test_grey_values_follow_the_recipe(sample: Phantom) -> None:
    from scipy import ndimage

    recipe = sample_recipe()
    grey = np.asarray(sample.scan.voxels).astype(float)
    z, y, x = np.ogrid[:160, :160, :160]
    outside = ((y - 79.5) ** 2 + (x - 79.5) ** 2 > recipe.field_of_view_radius**2) & (z >= 0)
    assert (grey[outside] == 0).all()
    assert (grey[~outside] > 0).all()
    void = ndimage.binary_erosion((sample.labels == 0) & ~outside, iterations=7)
    solid = ndimage.binary_erosion(sample.labels > 0, iterations=3)
    assert np.median(grey[void]) == pytest.approx(recipe.void, rel=0.02)
    assert np.median(grey[solid]) == pytest.approx(recipe.grain, rel=0.02)
    assert (grey[solid] > 0.5 * (recipe.grain + recipe.inclusion)).any()
    # Counting noise: standard deviation relative to the grain's value, smaller in the void by the root.
    residual = grey - ndimage.gaussian_filter(grey, 2)
    assert residual[void].std() == pytest.approx(recipe.noise * np.sqrt(recipe.void * recipe.grain), rel=0.1)


def test_surface_voxels_are_partly_filled(sample: Phantom) -> None:
    grey = np.asarray(sample.scan.voxels)
    between = (grey > 22_000) & (grey < 29_000)
    assert 0.05 < between[sample.labels >= 0].mean() < 0.4


def test_same_seed_same_scan_other_seed_other_scan(small_recipe: PhantomRecipe) -> None:
    first, again, other = (
        make_phantom(small_recipe, 3),
        make_phantom(small_recipe, 3),
        make_phantom(small_recipe, 4),
    )
    np.testing.assert_array_equal(first.labels, again.labels)
    np.testing.assert_array_equal(first.scan.voxels, again.scan.voxels)
    assert not np.array_equal(first.labels, other.labels)


def test_making_a_scan_tells_how_far_it_is_and_can_be_given_up(small_recipe: PhantomRecipe) -> None:
    shares: list[float] = []
    told = make_phantom(small_recipe, seed=1, progress=lambda share, _: shares.append(share))
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert 0.9 < shares[-1] < 1.0
    np.testing.assert_array_equal(told.scan.voxels, make_phantom(small_recipe, seed=1).scan.voxels)

    def give_up(share: float, _: str) -> None:
        if share > 0.2:
            raise Cancelled("The work was cancelled.")

    with pytest.raises(Cancelled):
        make_phantom(small_recipe, seed=1, progress=give_up)


@pytest.mark.parametrize("kind", ["cobble", "angular", "elongated", "concave"])
def test_kinds_of_grains(kind: str) -> None:
    grain = make_grain(kind, 30.0, np.random.default_rng(1))
    axis = np.arange(-grain.reach, grain.reach + 1)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = grain.body(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(x.shape)
    inside = values < 0
    for face in (inside[0], inside[-1], inside[:, 0], inside[:, -1], inside[..., 0], inside[..., -1]):
        assert not face.any()
    assert np.cbrt(6 * inside.sum() / np.pi) == pytest.approx(30, rel=0.2)
    # The value is about a distance near the surface: its slope there is one.
    slope = np.linalg.norm(np.gradient(values), axis=0)[np.abs(values) < 1]
    assert np.median(slope) == pytest.approx(1, abs=0.1)


def test_bad_recipes_are_refused(tmp_path: Path, small_recipe: PhantomRecipe) -> None:
    broken = tmp_path / "recipe.toml"
    broken.write_text("shape = [1, 2")
    with pytest.raises(ScanError, match=r"recipe\.toml"):
        PhantomRecipe.read(broken)
    broken.write_text("shape = [10, 20, 30]")
    with pytest.raises(ScanError, match="voxel_size"):
        PhantomRecipe.read(broken)
    with pytest.raises(ScanError, match="no kinds"):
        make_phantom(replace(small_recipe, kinds={}))
    with pytest.raises(ValueError, match="not a kind"):
        make_grain("brick", 10, np.random.default_rng(0))


def test_anisotropic_recipe_keeps_its_voxel_size(small_recipe: PhantomRecipe) -> None:
    size = VoxelSize(2, 1, 1, "mm")
    recipe = replace(small_recipe, voxel_size=size, kinds={"cobble": KindOfGrain(1.0, (20.0, 24.0))})
    phantom = make_phantom(recipe, 0)
    assert phantom.scan.voxel_size == size
    assert set(phantom.kinds) == {"cobble"}
