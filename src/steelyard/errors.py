"""The errors that a caller may want to catch."""

from __future__ import annotations


class SteelyardError(Exception):
    """Anything that steelyard reports on purpose; the text says where, what was found, and what to
    do.
    """


class InputError(SteelyardError):
    """A file, a value or an option is wrong; the command line ends with exit status 2."""


class InfeasibleError(SteelyardError):
    """The robot cannot do what was asked: no tensions within its limits, or a cable goes slack."""

    def __init__(self, message: str, sample: int = 0) -> None:
        super().__init__(message)
        self.sample = sample
        """At which sample it cannot."""
