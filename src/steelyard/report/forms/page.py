"""A document as one HTML page that needs nothing but itself, and reads without JavaScript where
there are tables.
"""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from steelyard.report.blocks.document import Document, Figure, Scene, flat
from steelyard.report.forms.figure_json import figure_json

if TYPE_CHECKING:
    from jinja2 import Template

_SIGNS = {"good": ("✓", "good"), "bad": ("✗", "problem"), "note": ("!", "note")}
"""Tone -> sign, and the word for those who hear the page."""


def page(document: Document) -> str:
    """HTML of a document; the same bytes for the same input.

    Names of the style sheet's colours may stand in figures where colours do: ``var(--good)``,
    ``var(--bad)``, ``var(--note)``, ``var(--ink)``, ``var(--muted)``, ``var(--edge)`` and
    ``var(--line-1)`` to ``var(--line-8)``, the palette. Traces of WebGL other than 3-D ones are not
    drawn: they would need scripts that write scripts, which the page forbids.
    """
    blocks = flat(block for section in document.sections for block in section.blocks)
    has_pictures = any(isinstance(block, Figure | Scene) for block in blocks)
    scripts = _scripts() if has_pictures else ()
    text = _template().render(
        document=document,
        kind=lambda block: type(block).__name__.lower(),
        signs=_SIGNS,
        json=figure_json,
        style=_part("page.css"),
        scripts=scripts,
        policy=_policy(scripts),
    )
    # What is no character (a name of a file in no encoding) would be an error where the page is
    # written.
    return text.encode("utf-8", "replace").decode("utf-8")


def palette() -> dict[str, str]:
    """Name -> colour of the style sheet in light, for pictures that stand on no page."""
    light, _, _ = _part("page.css").partition("@media")
    return dict(re.findall(r"--([a-z0-9-]+): (#[0-9a-f]{6})", light))


def _template() -> Template:
    """The template of the page: it escapes all it is given, and takes no name that is missing."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_part("page.html.j2"))


def _part(name: str) -> str:
    """A file of the folder ``web/``."""
    return (files("steelyard.report.forms") / "web" / name).read_text(encoding="utf-8")


@cache
def _scripts() -> tuple[str, ...]:
    """Scripts that draw pictures, in the order in which they run."""
    from plotly.offline import get_plotlyjs

    return get_plotlyjs(), f"\n{_part('scenes.js')}", f"\n{_part('figures.js')}"


def _policy(scripts: tuple[str, ...]) -> str:
    """What a browser may do with the page: run these very scripts, style, show pictures of its own;
    nothing else, no network.
    """
    digests = (
        base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts
    )
    known = " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"
    return (
        f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
