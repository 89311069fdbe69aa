"""The distribution annealer: the weight of the distribution item over the training."""

from __future__ import annotations

from dataclasses import dataclass

from mbstudio.core.errors import StyleError


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
                f"An annealer over a share of {self.share:g} of {self.steps} steps cannot be: give 0 to 1 of "
                "0 steps or more."
            )

    def weight(self, step: int) -> float:
        """Return the weight at a step, counted from 0."""
        rise = self.share * self.steps
        return 1.0 if step >= rise else step / rise

    @property
    def finished(self) -> int:
        """The first step with weight 1."""
        rise = self.share * self.steps
        return int(rise) + (rise > int(rise))
