from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template


def eight_points() -> Template:
    """The corners of a box as a template: flip f of corner i is corner i with f's bits turned."""
    corners = FLIPS * [0.4, 0.3, 0.2]
    exchange = np.array([[i ^ f for i in range(8)] for f in range(8)])
    return Template(corners, np.full(8, -2.0), exchange)


def two_avatars() -> Serialization:
    template = eight_points()
    rng = np.random.default_rng(7)
    return Serialization(
        template,
        template.centers + 0.05 * rng.normal(size=(2, 8, 3)),
        template.log_weights + 0.1 * rng.normal(size=(2, 8)),
        np.array([2.0, 3.0]),
        "mm",
        ("a", "b"),
        np.zeros(2),
        np.ones(2, bool),
    )


def test_flips_are_all_signs() -> None:
    assert len({tuple(row) for row in FLIPS.tolist()}) == 8
    assert set(np.abs(FLIPS).ravel()) == {1.0}


def test_template_refuses_points_that_are_not_symmetric() -> None:
    template = eight_points()
    with pytest.raises(SerializationError, match="symmetric"):
        Template(template.centers + np.array([0.1, 0, 0]), template.log_weights, template.exchange)
    with pytest.raises(SerializationError, match="permutations"):
        Template(template.centers, template.log_weights, np.zeros((8, 8), int))


@pytest.mark.parametrize("flip", range(8))
def test_flipping_mirrors_the_field(flip: int) -> None:
    avatars = two_avatars()
    flipped = avatars.flipped(np.array([flip, 0]))
    points = np.random.default_rng(0).normal(size=(50, 3)) * 2
    np.testing.assert_allclose(
        flipped.avatar(0).field(points * FLIPS[flip]), avatars.avatar(0).field(points), rtol=1e-12
    )
    np.testing.assert_array_equal(flipped.centers[1], avatars.centers[1])
    # Point i keeps its meaning: it stays near place i of the template.
    assert np.abs(flipped.centers[0] - avatars.template.centers).max() < 0.3


def test_avatar_has_size_and_unit() -> None:
    avatar = two_avatars().avatar(1)
    assert (avatar.unit, avatar.name) == ("mm", "b")
    np.testing.assert_allclose(avatar.centers, two_avatars().centers[1] * 3.0)
    np.testing.assert_allclose(avatar.weights, np.exp(two_avatars().log_weights[1]) * 9.0)


def test_take_keeps_rows_together() -> None:
    taken = two_avatars().take([1])
    assert taken.names == ("b",)
    assert taken.diameters.tolist() == [3.0]
    with pytest.raises(ValueError, match="read-only"):
        taken.centers[0] = 0.0
