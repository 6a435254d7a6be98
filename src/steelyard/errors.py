"""The errors that a caller may want to catch."""

from __future__ import annotations

import re

_OPTION = re.compile(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)")
"""How sentences write what a caller may choose."""
_ARGUMENTS = {
    "anyway": "anyway=True",
    "cables": "cable_set",
    "elastic": "elastic=True",
    "force": "force=True",
    "inertia-about": "about",
    "method": "methods",
    "reference-sigma": "sigma",
}
"""Option -> how Python calls it, where that is not the same word."""


def _in_python(option: re.Match[str]) -> str:
    """An option as an argument."""
    name = option[1]
    return _ARGUMENTS.get(name, name.replace("-", "_"))


class SteelyardError(Exception):
    """Anything that steelyard reports on purpose; the text says where, what was found, and what to
    do. In Python it names arguments, on the command line the options of the same meaning.
    """

    @property
    def on_command_line(self) -> str:
        """The text with the names of options."""
        return super().__str__()

    def __str__(self) -> str:
        return _OPTION.sub(_in_python, super().__str__().replace(" with --out", ""))


class InputError(SteelyardError):
    """A file, a value or an option is wrong; the command line ends with exit status 2."""


class AtRestError(InputError):
    """A recording of a motion is one of a platform that stands still."""


class WrongValueError(InputError, ValueError):
    """A value that was handed over in Python is wrong; a :class:`ValueError` too."""


class InfeasibleError(SteelyardError):
    """The robot cannot do what was asked: no tensions within its limits, or a cable goes slack."""

    def __init__(self, message: str, sample: int = 0) -> None:
        super().__init__(message)
        self.sample = sample
        """At which sample it cannot."""
