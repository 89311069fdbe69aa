"""Figures of populations say what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations import size_distribution
from mbstudio.scene.figures.form_figures import sneed_folk_figure, triangle, zingg_figure
from mbstudio.scene.figures.population_figures import (
    cdf_figure,
    distribution_figure,
    joint_figure,
    pdf_figure,
    shared_edges,
    sieve_figure,
)
from mbstudio.scene.pictures.figures import drawn
from mbstudio.scene.theme import LIGHT, rgb
from tests.core.populations.made import population


def near(image, colour):
    return (np.abs(image.astype(int) - rgb(colour)).max(axis=2) < 40).sum()


@pytest.fixture
def two(rng):
    """Grains and their avatars, whose sphericity is a tenth larger."""
    psi = rng.uniform(0.6, 0.8, 60)
    columns = {name: rng.uniform(0.5, 0.9, 60) for name in ("circularity", "dns", "csf")}
    axes = np.sort(rng.uniform(200, 500, (3, 60)), axis=0)
    columns.update(shortest=axes[0], intermediate=axes[1], longest=axes[2], volume=axes.prod(axis=0) / 2)
    columns.update(area=rng.uniform(2e5, 6e5, 60), dn=axes[1])
    return [
        population("grains", unit="um", sphericity=psi, **columns),
        population("avatars", unit="um", sphericity=1.1 * psi, **columns),
    ]


def words(figure) -> str:
    texts = [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]
    return "\n".join(texts)


@pytest.mark.parametrize("draw", [cdf_figure, pdf_figure])
def test_the_legend_states_the_relative_errors(two, draw):
    figure = draw(two, ["sphericity", "volume"])
    assert "avatars: δ mean 10.00 %, s.d. 10.00 %" in words(figure)
    assert "avatars: δ mean 0.00 %, s.d. 0.00 %" in words(figure)
    # Millions of cubic micrometres read as cubic millimetres.
    assert "Volume V (mm³)" in words(figure)
    image = drawn(figure)
    assert near(image, LIGHT.grain) > 300
    assert near(image, LIGHT.avatar) > 300


def test_the_staircase_is_that_of_the_values(two):
    axes = cdf_figure(two[:1], ["volume"]).axes[0]
    x, y = axes.lines[0].get_data()
    np.testing.assert_allclose(x[1:], np.sort(two[0].column("volume")) * 1e-9)  # um^3 in mm^3
    np.testing.assert_allclose(y[1:], np.arange(1, 61) / 60)


def test_one_body_and_equal_bodies_can_be_drawn():
    one = population(sphericity=[0.8], csf=[0.5], dn=[1.0])
    same = population("avatars", sphericity=[0.9, 0.9], csf=[0.5, 0.6], dn=[1.0, 1.0])
    for draw in (cdf_figure, pdf_figure, joint_figure):
        assert near(drawn(draw([one, same], ["sphericity", "csf", "dn"])), LIGHT.avatar) > 50


def test_a_population_without_measurements_is_named(two):
    empty = population("avatars", unit="um", reasons=["flat"], sphericity=[np.nan])
    assert "avatars" not in words(cdf_figure([two[0], empty], ["sphericity"]))
    with pytest.raises(MeasureError, match="nothing to draw"):
        zingg_figure([empty])


def test_the_matrix_has_a_panel_for_every_pair(two):
    figure = joint_figure(two, ["dn", "sphericity", "csf"])
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 6
    assert "grains (60)" in words(figure)


def test_the_sieve_curve_in_mm(two):
    grains = two[0]
    figure = sieve_figure([(grains, size_distribution(grains, "iso")), (two[1], size_distribution(two[1]))])
    axes = figure.axes[0]
    assert axes.get_xscale() == "log"
    openings, finer = axes.lines[0].get_data()
    assert set(np.round(openings, 6)) <= {0.125, 0.18, 0.25, 0.355, 0.5}
    assert finer[0] == 0
    assert finer[-1] == 100
    assert "ISO 3310-1" in axes.get_xlabel()
    assert "$C_u$" in words(figure)


def test_zingg_states_the_shares():
    b, c = [0.9, 0.9, 0.9, 0.5], [0.8, 0.8, 0.3, 0.2]
    bodies = population(longest=[1, 1, 1, 1], intermediate=b, shortest=c, volume=[1, 1, 1, 1])
    figure = zingg_figure([bodies])
    for said in ("equant  50 %", "disc  25 %", "blade  25 %", "rod  0 %"):
        assert said in words(figure)


def test_the_triangle_of_sneed_and_folk():
    corners = triangle(np.array([0.0, 1.0, 0.3]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(corners, [[0, 0], [1, 0], [0.5, np.sqrt(3) / 2]], atol=1e-12)
    bodies = population(longest=[2, 1], intermediate=[2, 0.15], shortest=[2, 0.1], volume=[1, 1])
    figure = sneed_folk_figure([bodies])
    assert words(figure).count("50 %") == 2
    assert near(drawn(figure), LIGHT.grain) > 20


def test_one_factor_has_its_cdf_beside_its_density(two):
    figure = distribution_figure(two, "sphericity")
    left, right = figure.axes
    assert left.get_xlabel() == right.get_xlabel() == "Sphericity ψ"
    assert left.get_ylabel() == "Cumulative share by number"
    assert right.get_ylabel() == "Density by number"
    assert "δ mean 10.00 %" in left.get_legend().get_texts()[1].get_text()
    image = drawn(figure)
    for half in np.array_split(image, 2, axis=1):
        assert near(half, LIGHT.grain) > 50
        assert near(half, LIGHT.avatar) > 50


def test_shared_bins_are_those_of_the_first_widened():
    # Eight values with quartiles 2 and 6: 2 x 4 / 8**(1/3) = 4 wide at most, so two bins over the span of 7.
    first = population("grains", csf=[1, 2, 3, 4, 5, 6, 7, 8])
    other = population("avatars", csf=[-3.0, 12.0])
    edges = shared_edges([first, other], "csf")
    np.testing.assert_allclose(np.diff(edges), 3.5)
    assert edges[0] <= -3.0
    assert edges[-1] >= 12.0
    np.testing.assert_allclose((edges - 1.0) / 3.5, np.round((edges - 1.0) / 3.5), atol=1e-9)
    assert len(shared_edges([population("grains", csf=[np.nan])], "csf")) == 0
