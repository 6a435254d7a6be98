"""Numbers that decide how the methods estimate, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass

from steelyard.identification.model.settings import PREPARATION, PreparationSettings


@dataclass(frozen=True)
class TwoStepSettings:
    """Of :class:`steelyard.TwoStep`."""

    preparation: PreparationSettings = PREPARATION
    """Of the samples."""
    block_spacings: float = 10.0
    """Length of a block of correlated residuals, in knot spacings of the filter, which correlates
    neighbours over some of them."""
    least_blocks: int = 10
    """From which a covariance is taken, at least [Newey1987]_: that of fewer scatters too much."""
    least_force: float = 1e-6
    """Below it there is no force to speak of [N]."""
    rounding: float = 1e-9
    """Singular values below this part of the largest are rounding."""
    noise_margin: float = 4.0
    """A direction counts as excited where its information is this many times what noise in the
    regressor alone would give: twice in amplitude."""
    slack_turns: int = 2
    """Times that slack cables of swings are looked for, each about the body that the rest tells."""


TWO_STEP = TwoStepSettings()
"""What is used where nothing is given."""
