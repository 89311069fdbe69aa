"""Items of the losses that style-learners minimise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxtyping import Float

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.probes import LARGEST_LOG_FIELD

if TYPE_CHECKING:
    import torch

_SMALLEST_LOG_SIGMA = -7.0


def normal_divergence(
    means: Float[torch.Tensor, "b d"], log_variances: Float[torch.Tensor, "b d"]
) -> Float[torch.Tensor, ""]:
    """Return the distribution item in nats: KL of N(mean, variance) to N(0, 1), summed over the latents.

    Notes
    -----
    ``1/2 sum(mu^2 + sigma^2 - ln sigma^2 - 1)``, mean over the batch (Zhao et al. 2023, the loss function
    of MetaballVAE).
    """
    return 0.5 * (means.square() + log_variances.exp() - log_variances - 1.0).sum(1).mean()


def reconstruction_item(
    made: Float[torch.Tensor, "b d"], truth: Float[torch.Tensor, "b d"]
) -> Float[torch.Tensor, ""]:
    """Return the paper's reconstruction item: the mean square over the d numbers of an avatar."""
    return (made - truth).square().mean(1).mean()


def parameter_error(
    made: Float[torch.Tensor, "b width"], truth: Float[torch.Tensor, "b width"], n: int
) -> Float[torch.Tensor, ""]:
    """Return the mean square error of vectors: 3/4 of the shifts', 1/4 of the weights'."""
    square = (made - truth).square()
    return 0.75 * square[:, : 3 * n].mean() + 0.25 * square[:, 3 * n : 4 * n].mean()


def log_field(
    points: Float[torch.Tensor, "b p 3"],
    centers: Float[torch.Tensor, "b n 3"],
    log_weights: Float[torch.Tensor, "b n"],
) -> Float[torch.Tensor, "b p"]:
    """Return ln f of each avatar at its own points."""
    square = (points[:, :, None, 0] - centers[:, None, :, 0]).square()
    square = square + (points[:, :, None, 1] - centers[:, None, :, 1]).square()
    square = square + (points[:, :, None, 2] - centers[:, None, :, 2]).square()
    terms = (square + 1e-9).reciprocal()
    return terms.bmm(log_weights.exp()[:, :, None])[:, :, 0].log()


def field_errors(
    centers: Float[torch.Tensor, "b n 3"],
    log_weights: Float[torch.Tensor, "b n"],
    surface: Float[torch.Tensor, "b p 3"],
    steepness: Float[torch.Tensor, "b p"],
    shell: Float[torch.Tensor, "b q 3"],
    shell_log_field: Float[torch.Tensor, "b q"],
) -> tuple[Float[torch.Tensor, ""], Float[torch.Tensor, ""]]:
    """Return how far decoded avatars are from their parents: on the surface, and off it.

    Parameters
    ----------
    centers, log_weights : tensors of shapes (b, n, 3), (b, n)
    surface, steepness : tensors of shapes (b, p, 3), (b, p)
        Points of the parents' surfaces, and the length of the gradient of their ln f there.
    shell, shell_log_field : tensors of shapes (b, q, 3), (b, q)
        Points off the surfaces, and the parents' ln f there, at most 2.5.

    Returns
    -------
    tuple of tensors
        Mean square of ``ln f / |grad ln f|`` (the distance to first order, in D_n), and of the error of
        ln f on the shells.
    """
    import torch

    p = surface.shape[1]
    found = log_field(torch.cat([surface, shell], 1), centers, log_weights)
    on_surface = (found[:, :p] / steepness).square().mean()
    off_surface = (found[:, p:].clamp(max=LARGEST_LOG_FIELD) - shell_log_field).square().mean()
    return on_surface, off_surface


def weighted_item(
    mean_square: Float[torch.Tensor, ""], log_sigma: Float[torch.Tensor, ""], count: float
) -> Float[torch.Tensor, ""]:
    """Return minus the log-likelihood of `count` errors with this mean square under a learned sigma."""
    log_sigma = log_sigma.clamp(min=_SMALLEST_LOG_SIGMA)
    return count * (0.5 * mean_square * (-2.0 * log_sigma).exp() + log_sigma)


@dataclass(frozen=True)
class DistributionAnnealer:
    """Weight of the distribution item of the loss: from 0, straight up to 1, then 1.

    A decoder that is punished for using the latents from the start learns the mean shape and nothing
    else (Zhao et al. 2023, section "The style-learner").

    Attributes
    ----------
    steps : int
        Of the training.
    share : float
        Of the steps over which the weight rises, 0 to 1; with 0 it is 1 from the start.

    Raises
    ------
    StyleError
        If steps is negative or share is not between 0 and 1.
    """

    steps: int
    share: float = 0.4

    def __post_init__(self) -> None:
        if self.steps < 0 or not 0 <= self.share <= 1:
            raise StyleError(
                f"An annealer over a share of {self.share:g} of {self.steps} steps is not possible: give 0 "
                "to 1 of 0 steps or more."
            )

    def weight(self, step: int) -> float:
        """Return the weight at a step, counted from 0."""
        rise = self.share * self.steps
        return 1.0 if step >= rise else step / rise

    @property
    def end(self) -> int:
        """The first step with weight 1."""
        rise = self.share * self.steps
        return int(rise) + (rise > int(rise))
