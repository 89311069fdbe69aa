"""Control points in another order, brought to that of the template."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import SerializationError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.serialize.assignment import assign_to_template
from mbstudio.core.vae.serialize.serialization import FLIPS
from tests.core.vae.bodies import ellipsoid_template, template_avatar


def test_shuffled_order_and_frame_are_recovered():
    template, rng = ellipsoid_template(40), np.random.default_rng(5)
    moved = template.centers + 0.015 * rng.normal(size=(40, 3))
    weights = np.exp(template.log_weights + 0.05 * rng.normal(size=40))
    whole = Avatar(moved * 200, weights * 200**2, "um", name="grain")
    shuffle = rng.permutation(40)
    turn = Rotation.from_euler("xyz", [0.4, 1.9, -0.6]).as_matrix()
    shuffled = Avatar(whole.centers[shuffle], whole.weights[shuffle], "um", name="grain")
    found = assign_to_template(shuffled.transformed(turn, np.array([900.0, -50, 3])), template)
    # The points were moved at random, so that the frame is a little turned from the template's. Which
    # half turn lies nearest is chance: one flip of the order that was lost, and no other order.
    wanted = template.exchange[[np.prod(signs) > 0 for signs in FLIPS]]
    log_weights = np.log(weights) - 2 * np.log(found.diameters[0] / 200)
    worst = [np.abs(found.log_weights[0] - log_weights[row]).max() for row in wanted]
    assert min(worst) < 1e-9
    row, signs = wanted[int(np.argmin(worst))], FLIPS[FLIPS.prod(axis=1) > 0][int(np.argmin(worst))]
    size = found.diameters[0] / 200
    assert np.abs(found.centers[0] * size - moved[row] * signs).max() < 0.1
    assert found.valid.all()
    # The avatar itself is only turned and moved: all distances are as they were.
    np.testing.assert_allclose(pdist(found.avatar(0).centers), pdist(whole.centers[row]), atol=1e-6)


def test_another_number_of_points_is_refused():
    with pytest.raises(SerializationError, match=r"'template' has 13 control points and the template 40"):
        assign_to_template(template_avatar(ellipsoid_template(13), 200), ellipsoid_template(40))


def test_points_from_elsewhere_are_refused():
    rng = np.random.default_rng(0)
    clumped = Avatar(
        rng.uniform(-9, 9, (40, 3)) + np.array([40, 0, 0]), np.full(40, 60.0), "um", name="clumped"
    )
    with pytest.raises(SerializationError, match="was not fitted from this template"):
        assign_to_template(clumped, ellipsoid_template(40))
