from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.features import Scaler, character, flipped_vectors, parity_parts
from tests.core.vae.populations import population


def test_character_multiplies_the_signs_of_the_axes() -> None:
    # Parity 5 changes sign with x and with z; flip 1 is x, flip 4 is z, flip 5 both.
    signs = character(np.array([0, 5]))
    assert signs[:, 0].tolist() == [1.0] * 8
    assert signs[[0, 1, 2, 4, 5], 1].tolist() == [1.0, -1.0, 1.0, -1.0, 1.0]


def test_vectors_and_back() -> None:
    parents = population(10)
    scaler = Scaler.from_parents(parents)
    vectors = scaler.vectors(parents)
    assert vectors.shape == (10, 4 * 16 + 1)
    again = scaler.avatars(vectors)
    np.testing.assert_allclose(again.centers, parents.centers, atol=1e-12)
    np.testing.assert_allclose(again.log_weights, parents.log_weights, atol=1e-12)
    np.testing.assert_allclose(again.diameters, parents.diameters, rtol=1e-8)


def test_size_is_its_normal_score() -> None:
    parents = replace(population(5), diameters=np.array([4.0, 1.0, 100.0, 2.0, 3.0]))
    scaler = Scaler.from_parents(parents)
    # Shares 0.1, 0.3, 0.5, 0.7, 0.9 of the standard normal distribution, in the order of size.
    expected = np.array([0.5244005, -1.2815516, 1.2815516, -0.5244005, 0.0])
    np.testing.assert_allclose(scaler.sizes(parents), expected, atol=1e-6)
    # Half way between two scores: half way between the logarithms.
    middle = scaler.sizes_of_scores(np.array([0.5 * 0.5244005]))
    np.testing.assert_allclose(np.exp(middle), np.sqrt(12.0), rtol=1e-6)


def test_size_of_another_unit_is_converted() -> None:
    parents = population(6)
    scaler = Scaler.from_parents(parents)
    in_um = replace(parents, unit="um", diameters=parents.diameters * 1000.0)
    np.testing.assert_allclose(scaler.vectors(in_um), scaler.vectors(parents), atol=1e-7)


def test_sizes_outside_of_the_parents_are_found_back() -> None:
    scaler = Scaler.from_parents(population(9))
    logs = np.array([-4.0, 0.0, 4.0])
    np.testing.assert_allclose(scaler.sizes_of_scores(scaler.size_scores(logs)), logs, atol=1e-12)


def test_one_size_for_all() -> None:
    parents = replace(population(5), diameters=np.full(5, 2.0))
    scaler = Scaler.from_parents(parents)
    np.testing.assert_allclose(scaler.sizes(parents), 0.0, atol=1e-9)
    np.testing.assert_allclose(scaler.avatars(scaler.vectors(parents)).diameters, 2.0, rtol=1e-9)


@pytest.mark.parametrize("flip", range(8))
def test_flipped_vectors_are_those_of_flipped_avatars(flip: int) -> None:
    parents = population(6)
    scaler = Scaler.from_parents(parents)
    mirrored = scaler.vectors(parents.flipped(np.full(6, flip)))
    np.testing.assert_allclose(
        flipped_vectors(scaler.vectors(parents), scaler.flip_table(), flip), mirrored, atol=1e-12
    )


def test_parity_parts_add_up_and_keep_their_sign() -> None:
    parents = population(6)
    scaler = Scaler.from_parents(parents)
    vectors, table = scaler.vectors(parents), scaler.flip_table()
    parts = parity_parts(vectors, table)
    np.testing.assert_allclose(parts.sum(0), vectors, atol=1e-12)
    for parity in range(8):
        for flip in range(8):
            np.testing.assert_allclose(
                flipped_vectors(parts[parity], table, flip),
                character(np.array(parity))[flip] * parts[parity],
                atol=1e-12,
            )


def test_another_template_is_refused() -> None:
    scaler = Scaler.from_parents(population(6))
    with pytest.raises(StyleError, match="n = 24 control points and the style-learner n = 16"):
        scaler.vectors(population(6, generators=3))
    parents = population(6)
    template = replace(parents.template, centers=parents.template.centers * 1.01)
    with pytest.raises(StyleError, match="another template"):
        scaler.vectors(replace(parents, template=template))
