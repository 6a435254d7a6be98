"""A page as PDF, printed by the browser that is installed: the page itself says how it looks on
paper.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from steelyard.errors import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
"""Programs that print a page without a window, by the names that systems give them."""
_FLAGS = (
    "--headless=new",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-sync",
    "--no-pdf-header-footer",
    # WebGL without a graphics card: the robot in 3-D.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # Pictures are drawn while it is printed.
    "--virtual-time-budget=20000",
)
_PATIENCE = 180.0
"""[s]; a report is printed within some seconds."""


def browser_for_pdf() -> str:
    """Path of a browser that can print.

    Raises:
        InputError: None is installed.
    """
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise InputError(
            f"--pdf: expected an installed browser ({', '.join(BROWSERS[:3])}), found none; install"
            " Chromium, or open the HTML page in any browser and print it"
        )
    return found


def write_pdf(page: Path, pdf: Path, browser: str, *, patience: float = _PATIENCE) -> None:
    """Print a page.

    Args:
        page: An HTML file.
        pdf: What to write.
        browser: As :func:`browser_for_pdf` finds it.
        patience: Time limit [s].

    Raises:
        InputError: The browser did not print it.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [
            browser,
            *_FLAGS,
            f"--user-data-dir={profile}",
            f"--print-to-pdf={pdf.resolve()}",
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # As root Chromium starts only so; of everybody else it keeps its sandbox.
            command.append("--no-sandbox")
        command.append(page.resolve().as_uri())
        try:
            subprocess.run(command, capture_output=True, timeout=patience, check=False)
        except subprocess.TimeoutExpired:
            raise InputError(
                f"--pdf: expected {Path(browser).name} to print within {patience:g} s, found that"
                " it did not; open the HTML page in a browser and print it"
            ) from None
        except OSError as error:
            raise InputError(
                f"--pdf: {browser}: cannot be started ({error.strerror}); open the HTML page in a"
                " browser and print it"
            ) from None
    if not pdf.is_file() or not pdf.read_bytes().startswith(b"%PDF-"):
        pdf.unlink(missing_ok=True)
        raise InputError(
            f"--pdf: expected a PDF file from {Path(browser).name}, found none; open the HTML page"
            " in a browser and print it"
        )
