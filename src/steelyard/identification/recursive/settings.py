"""Numbers that decide how a recursion goes, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RecursiveSettings:
    """How :class:`steelyard.Recursive` follows a stream."""

    begin: float = 5.0
    """Length of the recording that is fitted as a whole first [s]: it tells levels of noise, knots
    and values to linearise about."""
    longer: float = 1.6
    """By how much that is longer where the fit has not arrived, or the platform is still at
    rest."""
    longest: float = 90.0
    """Length of a beginning, at most [s]: of a rest that is longer, the end."""
    chunk: float = 0.4
    """Length of what is taken at once [s]; one spacing of the knots at least."""
    lag: float = 2.0
    """Length of the motion that is still fitted [s]."""
    looser: float = 60.0
    """See :attr:`.MotionSettings.looser_jointly`; where a motion goes on, by which jumps are seen,
    is told by nothing but its smoothness."""
    forgets: float = 10.0
    """Time over which it forgets how lively a motion was [s]."""
    foresights: int = 1
    """Steps by which a chunk finds its motion from its own instruments before the forces are looked
    at with them."""
    turns: int = 6
    """Linearisations of a chunk as it arrives, at most: one or two as a rule."""
    turns_of_beginning: int = 20
    """The same of a chunk of the beginning, for which nobody waits: where many readings count less
    for standing far, as of a gyro that was clipped, every step halves what the one before has
    left."""
    arrived: float = 3.0
    """Decrease of the cost, a chi-square, that the last step promised: what is left then is some
    hundreds of times smaller."""
    vibrates: float = 1.0
    """Variance of what a chunk leaves of the instruments of the motion, beyond that of their noise
    and in units of it, from which finer knots are tried: a wrong noise is rarely that large."""
    followed: float = 0.5
    """Part of that which finer knots may leave at most: else it is no vibration that they
    follow."""
    alarm: float = 1e-10
    """Probability with which a chunk looks by chance as if the load had changed: there are ten
    thousand in an hour, and some places for a change in each."""
    lately: float = 1e-3
    """The same where something has just changed: a hand does not let go, nor is a load put down, at
    once."""
    clear: float = 6.0
    """1-sigma that a load must weigh more or less to be another one."""


RECURSIVE = RecursiveSettings()
"""What is used where nothing is given."""
