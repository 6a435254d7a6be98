"""Noise as an experiment file states it: white, or with a part that follows itself.

Drifts, shifts and filters are stated beside the noise but act alike: a disturbance that goes on for
a while. Each is a Gauss-Markov process; the random walk is its limit of long correlation times.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from steelyard.files.file_model import FileModel

_LEAST_SIGMA = 1e-30
"""In any unit: squares of smaller ones, and of what is divided by them, leave the range of
numbers."""


def _possible(sigma: float) -> float:
    if 0 < sigma < _LEAST_SIGMA:
        raise ValueError(f"expected 0 or a number of a possible size, found {sigma:g}; correct it")
    return sigma


Sigma = Annotated[float, Field(ge=0), AfterValidator(_possible)]
AttitudeFilter = Annotated[float, Field(gt=0)]
"""Time constant with which an attitude follows the accelerometer [s]."""


class ColoredNoise(FileModel):
    """White noise, and a Gauss-Markov part beside it; what is absent is estimated."""

    white: Sigma | None = None
    """1-sigma per sample and axis."""
    colored: Sigma | None = None
    """1-sigma of the part that follows itself; 0: none."""
    time: Annotated[float, Field(gt=0)] | None = None
    """Correlation time of that part [s]."""

    def averaged(self, factor: float) -> ColoredNoise:
        """With this factor on the white part."""
        white = None if self.white is None else self.white * factor
        return self.model_copy(update={"white": white})


def _form(value: Any) -> str:
    return "colored" if isinstance(value, dict | ColoredNoise) else "white"


Noise = Annotated[
    Annotated[Sigma, Tag("white")] | Annotated[ColoredNoise, Tag("colored")], Discriminator(_form)
]
"""A number is the 1-sigma of white noise."""

Cause = Literal["colored", "drift", "reacquired", "filter"]
"""What makes a disturbance go on: the noise itself, a random walk, a target that was lost and found
again, an attitude that follows the accelerometer.
"""


@dataclass(frozen=True)
class Disturbance:
    """What is stated of an error of a quantity that goes on for a while."""

    cause: Cause
    level: float | None
    """1-sigma in the unit of the quantity, of a drift per root of a second; 0: there is none; None:
    from the data."""
    time: float | None = None
    """Correlation time [s]; None: from the data, of a drift it is none."""
    vertical: bool = False
    """Whether a rotation is about the vertical alone."""


def white_part(noise: float | ColoredNoise | None) -> float | None:
    """1-sigma of the white part; None: not stated."""
    return noise.white if isinstance(noise, ColoredNoise) else noise


def with_colored_part(
    noise: float | ColoredNoise | None, *others: Disturbance | None
) -> tuple[Disturbance, ...]:
    """All that is stated of a quantity: the coloured part of its noise, and others that are
    there.
    """
    found = [each for each in others if each is not None]
    if isinstance(noise, ColoredNoise) and (noise.colored is not None or noise.time is not None):
        found.insert(0, Disturbance("colored", noise.colored, noise.time))
    return tuple(found)


def drift(density: float | None, *, vertical: bool = False) -> Disturbance | None:
    """A random walk; None: not stated."""
    return None if density is None else Disturbance("drift", density, vertical=vertical)


def reacquired(shift: float | None) -> Disturbance | None:
    """A shift after every loss of the target [m]; None: not stated."""
    return None if shift is None else Disturbance("reacquired", shift)


def of_orientation(
    noise: float | ColoredNoise | None, constant: float | None, heading: float | None
) -> tuple[Disturbance, ...]:
    """All that is stated of an orientation: its noise, the time constant of the filter that it
    comes from [s], how its heading walks [rad/sqrt(s)].
    """
    # It leans for about the time constant of its filter, by what the data tell.
    lean = None if constant is None else Disturbance("filter", None, constant)
    return with_colored_part(noise, lean, drift(heading, vertical=True))


def averaged(noise: float | ColoredNoise, factor: float) -> float | ColoredNoise:
    """Noise of averages: white noise falls by a factor, what goes on for a while stays."""
    return noise.averaged(factor) if isinstance(noise, ColoredNoise) else noise * factor
