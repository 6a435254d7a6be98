"""Follows a page as a new reader does: unpacks the project into a new folder and types every
command of the page.

Usage: python docs/follow.py docs/tutorial.md
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

from session import CommandError, Session, blocks, screen

ROOT = Path(__file__).parents[1]
NOT_OURS = (
    "PYTHONPATH",
    "PYTHONHOME",
    "PYTHONDONTWRITEBYTECODE",
    "VIRTUAL_ENV",
    "OPENBLAS_NUM_THREADS",
    "MAKEFLAGS",
    "MAKELEVEL",
    "MFLAGS",
)
"""Variables that a new reader has not."""


def unpack(folder: Path) -> None:
    """What the project has under version control, as it is now."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    for name in filter(None, listed.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)


def follow(page: Path) -> None:
    """Type every command of a page, and print each with its time.

    Raises:
        CommandError: One of them ended with another status than the page says.
    """
    with tempfile.TemporaryDirectory(prefix="steelyard-follow-") as temporary:
        root = Path(temporary) / "steelyard"
        unpack(root)
        with Session(root, without=NOT_OURS) as session:
            for block in blocks(page.read_text(encoding="utf-8")):
                began = time.monotonic()
                session.do(block)
                done = (
                    [screen(command) for command in block.commands]
                    if block.kind == "shell"
                    else [f"(write {block.name})"]
                )
                print("\n".join(done), f"   # {time.monotonic() - began:.1f} s", flush=True)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        try:
            follow(Path(name))
        except CommandError as error:
            sys.exit(f"{name}: {error}")
