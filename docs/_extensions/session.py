"""The commands that stand in a page, and a shell that runs them one after the other.

The build of the documentation shows what they print (``shell.py``), and ``follow.py`` does what a
reader does: both by this module. A page has blocks ``{shell}``, one command a line (a backslash at
its end goes on in the next one), and ``{file} NAME``, whose text is written.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

LONGEST = 600.0
"""Time that a command may take [s]."""
_END = "\x1e"
_FENCE = re.compile(r"^(`{3,})\{(shell|file)\}[ \t]*(.*)$")
_OPTION = re.compile(r"^:([a-z]+):[ \t]*(.*)$")
_OPTIONS = {"shell": {"status", "lines", "hidden", "setup"}, "file": {"language"}}

Kind = Literal["shell", "file"]


class CommandError(Exception):
    """A command did not end as the page says."""


@dataclass(frozen=True)
class Block:
    """What stands in one block of a page."""

    kind: Kind
    name: str
    """Of the file to write."""
    text: str
    """Commands, or what the file holds."""
    status: int = 0
    """With which each command is to end."""
    setup: bool = False
    """Whether it only makes the environment in which the others run: the build shows it and runs it
    not."""
    line: int = 0

    @property
    def commands(self) -> tuple[str, ...]:
        """Of a ``{shell}`` block, in order, as they stand there."""
        found: list[str] = []
        going_on = False
        for line in self.text.splitlines():
            if not line.strip() and not going_on:
                continue
            if going_on:
                found[-1] += f"\n{line}"
            else:
                found.append(line)
            going_on = line.endswith("\\")
        return tuple(found)


def block(kind: Kind, name: str, options: Mapping[str, str], text: str, line: int = 0) -> Block:
    """What a block with its options is.

    Raises:
        ValueError: It has an option that there is not.
    """
    unknown = set(options) - _OPTIONS[kind]
    if unknown:
        raise ValueError(
            f"expected options {', '.join(sorted(_OPTIONS[kind]))}, found"
            f" {', '.join(sorted(unknown))}"
        )
    return Block(kind, name, text, int(options.get("status") or 0), "setup" in options, line)


def blocks(page: str) -> Iterator[Block]:
    """Blocks of a Markdown page, in order."""
    lines = page.splitlines()
    i = 0
    while i < len(lines):
        opened = _FENCE.match(lines[i])
        i += 1
        if not opened:
            continue
        begin, (fence, kind, name) = i, opened.groups()
        while i < len(lines) and lines[i].rstrip() != fence:
            i += 1
        body, options = lines[begin:i], {}
        while body and (option := _OPTION.match(body[0])):
            options[option[1]] = option[2]
            body = body[1:]
        yield block(kind, name.strip(), options, "\n".join(body).strip("\n") + "\n", begin)  # type: ignore[arg-type]


class Session:
    """A shell in a folder; variables, folder and environment last from one command to the next."""

    def __init__(
        self, folder: Path, *, first: Sequence[Path] = (), without: Sequence[str] = ()
    ) -> None:
        """Open it.

        Args:
            folder: In which it begins.
            first: Folders to look for programs in before all others.
            without: Variables of the environment that it does not have.
        """
        environment = {key: value for key, value in os.environ.items() if key not in without}
        environment |= {"PATH": os.pathsep.join([*map(str, first), environment.get("PATH", "")])}
        # As on a terminal of usual width, without colours.
        environment |= {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONUNBUFFERED": "1"}
        self.folder = folder
        self._shell = subprocess.Popen(
            ["bash", "--norc", "--noprofile"],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the shell and what it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._shell.pid, signal.SIGKILL)
        self._shell.communicate()

    def run(self, command: str) -> tuple[int, str]:
        """Run one command: its exit status, and what it has printed.

        Raises:
            CommandError: It takes too long, or has ended the shell.
        """
        assert self._shell.stdin is not None
        assert self._shell.stdout is not None
        late = threading.Timer(LONGEST, os.killpg, (self._shell.pid, signal.SIGKILL))
        late.start()
        try:
            # By eval, so that a mistake in it is one of this command, and nothing of it is read as
            # the next one.
            self._shell.stdin.write(
                f"eval {shlex.quote(command)} </dev/null; printf '{_END}%s\\n' $?\n"
            )
            self._shell.stdin.flush()
            printed = ""
            for line in self._shell.stdout:
                before, end, status = line.partition(_END)
                printed += before
                if end:
                    return int(status), printed
        except BrokenPipeError:
            printed = ""
        finally:
            late.cancel()
        raise CommandError(
            f"'{command}' ended the shell, or took more than {LONGEST:g} s; it had"
            f" printed:\n{printed}"
        )

    def do(self, block: Block) -> str:
        """Do what a block says: commands with what they print, as on a screen, or the file that was
        written.

        Raises:
            CommandError: A command ended with another status than the page says.
        """
        if block.kind == "file":
            (self.folder / block.name).write_text(block.text, encoding="utf-8")
            return block.text
        shown = ""
        for command in block.commands:
            status, printed = self.run(command)
            if status != block.status:
                raise CommandError(
                    f"'{command}' should end with status {block.status}, ended with {status}; it"
                    f" had printed:\n{printed}"
                )
            shown += f"{screen(command)}\n{printed}"
            if not shown.endswith("\n"):
                shown += "\n"
        return shown


def screen(command: str) -> str:
    """A command behind its prompt."""
    first, *others = command.splitlines()
    return "\n".join([f"$ {first}", *(f"> {line}" for line in others)])


def part_of(text: str, wanted: str) -> str:
    """Some lines of a text, ``2-5,9-``, with a mark where others are left out.

    Raises:
        ValueError: That is no range, or there are no such lines.
    """
    lines, shown, after = text.splitlines(), [], 0
    for each in wanted.split(","):
        first, dash, last = each.strip().partition("-")
        begin, end = int(first), int(last) if last else len(lines) if dash else int(first)
        if not after < begin <= end <= len(lines):
            raise ValueError(f"expected ascending lines of {len(lines)}, found '{each.strip()}'")
        if begin > after + 1:
            shown.append("…")
        shown += lines[begin - 1 : end]
        after = end
    if after < len(lines):
        shown.append("…")
    return "\n".join(shown) + "\n"
