"""A disk that fails, or a process that is killed, at one chosen call of the operating system.

Every function of :mod:`os` that changes a disk is counted, and the one call of the C library that
exchanges two names. A kill is played by an exception that every later call raises too: what stands
on the disk is what a killed process would have left, while the test goes on.
"""

import errno
import os
from contextlib import contextmanager

import pytest

from steelyard.output import disk, placing

CHANGING = (
    "chmod", "chown", "fsync", "link", "mkdir", "open", "remove", "rename", "replace", "rmdir",
    "symlink", "unlink", "utime", "write",
)  # fmt: skip
SPACE = frozenset({"link", "mkdir", "open", "write", "exchange"})
"""Calls that a full disk may refuse."""


class Killed(BaseException):
    """The process is gone."""


class Disk:
    """The calls so far, and what happens at one of them."""

    def __init__(self, at=None, how=None):
        self.calls = []
        self.at, self.how = at, how

    def __call__(self, name, call, arguments, options):
        if name == "open" and not arguments[1] & (os.O_CREAT | os.O_TRUNC):
            return call(*arguments, **options)
        number = len(self.calls)
        self.calls.append((name, *map(str, arguments[:2])))
        if self.at is None or number < self.at:
            return self.done(name, call, arguments, options)
        if self.how == "kill":
            if number == self.at and name == "write":
                # Half of it has arrived.
                call(arguments[0], bytes(arguments[1])[: len(arguments[1]) // 2])
            raise Killed
        if self.how == "full":
            if name in SPACE:
                raise self.error(errno.ENOSPC, name, arguments)
        elif number == self.at:
            raise self.error(self.how, name, arguments)
        return self.done(name, call, arguments, options)

    def done(self, name, call, arguments, options):
        # Real ones take long and change nothing that a test could see.
        return None if name == "fsync" else call(*arguments, **options)

    def error(self, number, name, arguments):
        # As the system does: an open file has no name.
        named = [] if name in ("write", "fsync") else [str(arguments[0])]
        return OSError(number, os.strerror(number), *named)


@contextmanager
def calls_to(disk_):
    """Let all changes of disks pass through one."""
    with pytest.MonkeyPatch.context() as patch:

        def watched(name, call):
            return lambda *arguments, **options: disk_(name, call, arguments, options)

        for name in CHANGING:
            patch.setattr(os, name, watched(name, getattr(os, name)))
        patch.setattr(placing, "exchange", watched("exchange", disk.exchange))
        # Their lists of functions that take open folders know the true ones only.
        patch.setattr("shutil._use_fd_functions", False)
        yield disk_


WAYS = {
    "kill": "kill",
    "no space once": errno.ENOSPC,
    "no space from then on": "full",
    "input/output error": errno.EIO,
    "interrupted": errno.EINTR,
}
"""What may happen at a call."""
