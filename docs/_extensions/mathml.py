"""Mathematics as MathML, which browsers draw themselves: pages need no network and no script."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)


_DIGITS = re.compile(r"\\([td]?frac)(\d)(\d)")
"""A fraction of two digits without braces; the converter would take both for the numerator."""


def _drawn(node: nodes.Element, *, block: bool) -> str:
    try:
        return tex2mathml(_DIGITS.sub(r"\\\1{\2}{\3}", node.astext()), as_block=block)
    except MathError as error:
        logger.warning(
            "mathematics that cannot be turned into MathML: %s: %s",
            error,
            node.astext(),
            location=node,
        )
        return ""


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_drawn(node, block=False))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({node["number"]})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append(_drawn(node, block=True) + "</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))  # type: ignore[arg-type]
    return {"parallel_read_safe": True, "parallel_write_safe": True}
