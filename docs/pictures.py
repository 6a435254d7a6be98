"""Draws the pictures that README.md and the documentation show, into docs/images: `make pictures`.

They are kept in the repository, since a README is read where nothing can be run. Needs Chromium.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from steelyard.report.pdf import browser_for_pdf

IMAGES = Path(__file__).parent / "images"
PICTURES = {
    "report": (["demo", "--out", "demo"], "demo/report.html", (1100, 1000)),
    "robot": (["robots", "cogiro", "--out", "robot.html"], "robot.html", (1100, 900)),
    "design": (
        ["design", "cogiro", "--duration", "8", "--budget", "30", "--out", "design"],
        "design/design.html",
        (1100, 1000),
    ),
}
"""Name -> command, the page that it writes, and how much of that is shown [px]."""
_FLAGS = (
    "--headless=new",
    "--disable-background-networking",
    "--hide-scrollbars",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--virtual-time-budget=20000",
)


def draw(name: str, folder: Path) -> None:
    """Run a command in a folder and photograph its page."""
    command, page, (width, height) = PICTURES[name]
    done = [sys.executable, "-m", "steelyard", *command, "--quiet"]
    subprocess.run(done, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
    subprocess.run(
        [
            browser_for_pdf(),
            *_FLAGS,
            *as_root,
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={width},{height}",
            f"--screenshot={(IMAGES / name).with_suffix('.png')}",
            (folder / page).as_uri(),
        ],
        check=True,
        capture_output=True,
    )


def main() -> None:
    """Draw all of them, or those that are named."""
    IMAGES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            draw(name, Path(folder))
        print(f"docs/images/{name}.png")


if __name__ == "__main__":
    main()
