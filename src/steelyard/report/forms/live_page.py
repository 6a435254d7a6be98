"""The page that shows estimates as they come: the same for every experiment, filled by its
script.
"""

from __future__ import annotations

import base64
import hashlib
import json
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from steelyard.digits import LABELS

_LEFT_OVER = (
    *((f"force {axis}", "N", 1.0) for axis in "xyz"),
    *((f"torque {axis}", "N m", 1.0) for axis in "xyz"),
)


@dataclass(frozen=True)
class LivePage:
    """HTML, and what a browser may do with it."""

    html: str
    policy: str
    """Content-Security-Policy: this very script and style, and estimates from where it came
    from."""


def live_page(title: str) -> LivePage:
    """The page.

    Args:
        title: Name of the experiment.
    """
    style = f"{_part('page.css')}{_part('live.css')}"
    numbers = json.dumps({"ten": LABELS, "left_over": _LEFT_OVER}, ensure_ascii=False)
    script = _part("live.js").replace("/* numbers */ null", numbers)
    text = _part("live.html")
    for name, value in (("title", escape(title)), ("style", style), ("script", script)):
        text = text.replace(f"<!-- {name} -->", value)
    text = text.encode("utf-8", "replace").decode("utf-8")
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}';"
        " connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none';"
        " frame-ancestors 'none'"
    )
    return LivePage(text, policy)


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _part(name: str) -> str:
    """A file of the folder ``web/``."""
    return (files("steelyard.report.forms") / "web" / name).read_text(encoding="utf-8")
