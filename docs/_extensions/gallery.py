"""Pages for the gallery, made by the commands that its readers have: report, inspection, comparison
and design of the simulated robot.

They are written beside the built pages. With ``-D shell_execute=0`` they are not made.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
FOLDER = "gallery"
COMMANDS = (
    ("demo", "--out", "demo"),
    ("inspect", "demo/experiment.yaml", "--out", "inspection"),
    ("compare", "demo:all", "--out", "comparison"),
    ("design", "cogiro", "--duration", "4", "--out", "design"),
)
"""What is run, one after the other in one folder."""
PAGES = {
    "report.html": "demo/report.html",
    "runs.html": "demo/paper-moves/report.html",
    "inspection.html": "inspection/inspection.html",
    "comparison.html": "comparison/comparison.html",
    "design.html": "design/design.html",
}
"""Page of the gallery -> what a command wrote."""


def make(app: Sphinx, error: Exception | None) -> None:
    """Run the commands and put their pages beside those that were built."""
    if error is not None or app.builder.format != "html" or not app.config.shell_execute:
        return
    target = Path(app.outdir) / FOLDER
    target.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for command in COMMANDS:
            done = subprocess.run(
                [sys.executable, "-m", "steelyard", *command],
                cwd=folder,
                capture_output=True,
                text=True,
            )
            if done.returncode:
                logger.warning("gallery: steelyard %s: %s", command[0], done.stderr.strip())
                return
        for name, made in PAGES.items():
            shutil.copyfile(Path(folder) / made, target / name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Let Sphinx know."""
    app.connect("build-finished", make)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
