from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.losses import (
    DistributionAnnealer,
    field_errors,
    normal_divergence,
    parameter_error,
    reconstruction_item,
    weighted_item,
)
from mbstudio.core.vae.models.optimizer import one_cycle_rate


def test_divergence_of_known_normal_distributions() -> None:
    zero = torch.zeros(3, 2)
    assert normal_divergence(zero, zero).item() == 0.0
    # N(1, 4): (1 + 4 - ln 4 - 1) / 2; the other latent is N(0, 1).
    means = torch.tensor([[1.0, 0.0]])
    log_variances = torch.tensor([[math.log(4.0), 0.0]])
    assert normal_divergence(means, log_variances).item() == pytest.approx(0.5 * (4 - math.log(4)), rel=1e-6)


def test_paper_loss_of_two_control_points() -> None:
    # (k, x, y, z) of two points; only one k is off by 2 and one x by 4: (4 + 16) / 8.
    truth = torch.tensor([[1.0, 0.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0]])
    made = torch.tensor([[3.0, 0.0, 0.0, 0.0, 1.0, 7.0, 0.0, 0.0]])
    assert reconstruction_item(made, truth).item() == pytest.approx(2.5)


def test_shuffled_points_are_best_met_by_their_mean() -> None:
    # Why the literal model collapses: of two orders of one avatar, both points at the mean cost least.
    orders = torch.tensor([[1.0, -1.0], [-1.0, 1.0]])
    collapsed = reconstruction_item(torch.zeros(2, 2), orders).item()
    guessed = reconstruction_item(torch.tensor([[1.0, -1.0], [1.0, -1.0]]), orders).item()
    assert (collapsed, guessed) == (1.0, 2.0)


def test_parameter_error_weighs_shifts_three_to_one() -> None:
    truth = torch.zeros(1, 5)  # one control point: dx, dy, dz, dln k, size
    assert parameter_error(torch.tensor([[3.0, 0, 0, 0, 9.0]]), truth, 1).item() == pytest.approx(0.75 * 3)
    assert parameter_error(torch.tensor([[0, 0, 0, 2.0, 9.0]]), truth, 1).item() == pytest.approx(0.25 * 4)


def test_field_errors_of_spheres() -> None:
    # A sphere of radius 0.5 made 0.51: ln f = 2 ln(0.51 / 0.5) on its parent's surface, where the
    # gradient of ln f has length 2 / 0.5.
    surface = torch.tensor([[[0.5, 0, 0], [0, -0.5, 0]]])
    shell = torch.tensor([[[0.25, 0, 0]]])
    on, off = field_errors(
        torch.zeros(1, 1, 3), torch.tensor([[math.log(0.51**2)]]), surface, torch.full((1, 2), 4.0),
        shell, torch.tensor([[math.log(4.0)]]),
    )  # fmt: skip
    step = 2 * math.log(0.51 / 0.5)
    assert on.item() == pytest.approx((step / 4) ** 2, rel=1e-3)
    assert off.item() == pytest.approx(step**2, rel=1e-3)


def test_field_deep_inside_is_cut_off() -> None:
    far_in = torch.tensor([[[1e-3, 0, 0]]])
    _, off = field_errors(
        torch.zeros(1, 1, 3), torch.zeros(1, 1), far_in, torch.ones(1, 1), far_in, torch.full((1, 1), 2.5)
    )
    assert off.item() == 0.0


def test_weighted_item_is_least_where_sigma_is_the_error() -> None:
    square = torch.tensor(0.04)
    sigmas = torch.log(torch.tensor([0.1, 0.2, 0.4]))
    values = [weighted_item(square, sigma, 2.0).item() for sigma in sigmas]
    assert values[1] == min(values)
    assert values[1] == pytest.approx(2 * (0.5 + math.log(0.2)), rel=1e-5)


def test_annealer_rises_straight_from_0_to_1() -> None:
    annealer = DistributionAnnealer(100, 0.4)
    assert [annealer.weight(step) for step in (0, 10, 20, 40, 99)] == [0.0, 0.25, 0.5, 1.0, 1.0]
    assert annealer.end == 40
    assert DistributionAnnealer(100, 0.0).weight(0) == 1.0


@pytest.mark.parametrize(("steps", "share"), [(-1, 0.4), (10, 1.5), (10, -0.1)])
def test_impossible_annealers_are_refused(steps: int, share: float) -> None:
    with pytest.raises(StyleError, match="annealer"):
        DistributionAnnealer(steps, share)


def test_one_cycle_is_highest_after_three_tenths() -> None:
    rates = [one_cycle_rate(step, 100, 1.0) for step in range(100)]
    assert int(np.argmax(rates)) == 30
    assert (rates[0], rates[30]) == pytest.approx((0.04, 1.0))
    assert rates[99] < 1e-3
