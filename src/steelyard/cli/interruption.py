"""Ctrl-C and polite kills end the program, even where a library swallows the exception."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED, TERMINATED = 130, 143
"""Exit status after SIGINT and after SIGTERM."""
_PERIOD = 0.05
"""[s] after which the exception is raised again where it has not got through."""
_LONGEST = 1.5
"""[s] that unwinding may take; then the process ends as it is. Results are whole even so, and the
next run removes what is left of unfinished ones."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Within, SIGINT raises KeyboardInterrupt and SIGTERM SystemExit until one gets out of the
    block; a second signal ends the process at once.
    """
    interruption = _Interruption()
    before, unraisable = signal.getsignal(signal.SIGINT), sys.unraisablehook

    def lost(unraised: sys.UnraisableHookArgs) -> None:
        # Python prints a traceback of what it cannot raise, as where the signal comes while it
        # clears an object away. The timer raises it again: nothing is lost that needs to be told.
        if interruption.number is None or not _is_of(unraised.exc_value, interruption.number):
            unraisable(unraised)

    sys.unraisablehook = lost
    signal.signal(signal.SIGTERM, interruption.begin)
    if before is not signal.SIG_IGN:
        # Of what runs in the background, a shell has Ctrl-C ignored.
        signal.signal(signal.SIGINT, interruption.begin)
    try:
        yield
    except BaseException as error:
        # Wrappers of C code also make other errors of it.
        if interruption.number is not None and not _is_of(error, interruption.number):
            raise _exception(interruption.number) from error
        raise
    finally:
        # The timer last: a signal that comes now may still begin it.
        signal.signal(signal.SIGINT, before)
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))
        _stop_timer()
        sys.unraisablehook = unraisable


class _Interruption:
    """What has been asked for, and since when.

    An exception of a signal handler is raised wherever the program happens to be. Wrappers of
    CasADi catch every exception while they look for a fitting type, so that most are lost there:
    a timer raises it again until it is being handled.
    """

    def __init__(self) -> None:
        self.number: int | None = None
        self.since = 0.0

    def begin(self, number: int, _frame: FrameType | None) -> None:
        """A signal has come."""
        if self.number is not None:
            _end_at_once(self.number)
        self.number, self.since = number, time.monotonic()
        signal.signal(signal.SIGALRM, self.again)
        # A signal that comes while the block is left takes its last lines with it; a timer that
        # still runs when Python has taken its handlers away would be what ends the process.
        atexit.register(_stop_timer)
        signal.setitimer(signal.ITIMER_REAL, _PERIOD, _PERIOD)
        raise _exception(number)

    def again(self, _number: int, _frame: FrameType | None) -> None:
        """Look whether the exception is on its way out."""
        if self.number is None:
            return
        if time.monotonic() - self.since > _LONGEST:
            _end_at_once(self.number)
        if not _is_handled(self.number):
            raise _exception(self.number)


def _stop_timer() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0)


def _exception(number: int) -> BaseException:
    return KeyboardInterrupt() if number == signal.SIGINT else SystemExit(TERMINATED)


def _is_handled(number: int) -> bool:
    """Whether the program is cleaning up after the exception already."""
    error = sys.exc_info()[1]
    while error is not None and not _is_of(error, number):
        error = error.__context__
    return error is not None


def _is_of(error: BaseException | None, number: int) -> bool:
    return isinstance(error, type(_exception(number)))


def _end_at_once(number: int) -> None:
    """End this process and those that it has begun, without unwinding."""
    if "multiprocessing" in sys.modules:
        import multiprocessing

        for child in multiprocessing.active_children():
            child.kill()
    os._exit(INTERRUPTED if number == signal.SIGINT else TERMINATED)
