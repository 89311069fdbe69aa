from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.field import control_rows
from mbstudio.core.metaball.surface import sample_solid
from mbstudio.core.metrics import measure
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.live_grain import MOVING, live_grain, surface_on_grid
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def learner() -> StyleLearner:
    return learn(boxes(40, np.random.default_rng(2)), preset="pca", seed=0)


def test_the_surface_of_one_control_point_is_a_ball() -> None:
    control = control_rows(np.array([[1.0, 2.0, 3.0]]), np.array([4.0]))
    points, triangles, normals = surface_on_grid(*sample_solid(control, MOVING), control)
    away = points - np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 2.0, rtol=1e-4)
    np.testing.assert_allclose(normals, away / 2.0, atol=2e-4)
    a, b, c = (points[triangles[:, corner]].astype(float) for corner in range(3))
    assert (np.cross(b - a, c - a) * (a - [1.0, 2.0, 3.0])).sum(axis=1).min() > 0  # all face outward
    # Every edge of a closed surface belongs to two triangles, once in each direction.
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    assert set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1]))
    assert len(np.unique(edges, axis=0)) == len(edges)


def test_a_live_grain_is_the_decoded_avatar_with_its_measures(learner: StyleLearner) -> None:
    shown = live_grain(learner, learner.latents[3], MOVING)
    avatar = learner.decode(learner.latents[3:4]).avatar(0)
    np.testing.assert_array_equal(shown.avatar.centers, avatar.centers)
    np.testing.assert_array_equal(shown.avatar.weights, avatar.weights)
    known = measure(avatar)
    assert shown.volume == pytest.approx(known.volume, rel=2e-3)
    assert shown.area == pytest.approx(known.area, rel=5e-3)
    assert shown.values["size"] == pytest.approx((6 * known.volume / np.pi) ** (1 / 3), rel=5e-3)
    assert shown.is_sound


def test_volume_and_validity_do_not_depend_on_the_level_of_detail(learner: StyleLearner) -> None:
    coarse, fine = (live_grain(learner, learner.latents[5], cells) for cells in (24, 64))
    assert coarse.volume == fine.volume
    np.testing.assert_array_equal(coarse.factors, fine.factors)
    assert len(fine.points) > 4 * len(coarse.points)


def test_a_grain_in_two_pieces_is_told_to_be_none(learner: StyleLearner) -> None:
    class Torn:
        """A learner all of whose grains are two balls apart."""

        dimension = learner.dimension

        def decode(self, latents: np.ndarray, names: tuple[str, ...] = ()) -> object:
            made = learner.decode(latents, names=names)
            away = np.where(np.arange(made.centers.shape[1]) % 2, 3.0, -3.0)
            torn = np.zeros_like(made.centers)
            torn[0, :, 0] = away
            object.__setattr__(made, "centers", torn)
            return made

    shown = live_grain(Torn(), learner.latents[0], MOVING)  # type: ignore[arg-type]
    assert (shown.pieces, shown.is_sound) == (2, False)


def test_a_latent_vector_of_another_learner_is_refused(learner: StyleLearner) -> None:
    with pytest.raises(StyleError, match="does not fit"):
        live_grain(learner, np.zeros(learner.dimension + 1))


def test_the_avatar_takes_its_name(learner: StyleLearner) -> None:
    shown = live_grain(learner, learner.latents[0], MOVING, name="kept 3")
    assert isinstance(shown.avatar, Avatar)
    assert shown.avatar.name == "kept 3"
