"""Citations: ``[Tempel2017]`` in a Markdown page is the same link that ``[Tempel2017]_`` is in a
docstring.

Their definitions are the items ``- **[Tempel2017]** …`` of the page of references, which so stays
readable where nothing is built.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

_KEY = re.compile(r"\[([A-Z][A-Za-z]+\d{4})\](?!_)")


class Citations(SphinxTransform):
    """Makes citations of what looks like them in Markdown."""

    default_priority: ClassVar[int] = 610  # before Sphinx collects citations

    def apply(self, **_: Any) -> None:
        """Transform the document."""
        for item in list(self.document.findall(nodes.list_item)):
            self._define(item)
        for text in list(self.document.findall(nodes.Text)):
            self._refer(text)
        for bullets in list(self.document.findall(nodes.bullet_list)):
            if bullets.children and all(
                isinstance(child, nodes.citation) for child in bullets.children
            ):
                bullets.replace_self(bullets.children)

    def _define(self, item: nodes.list_item) -> None:
        first = item.next_node(nodes.strong)
        found = _KEY.fullmatch(first.astext()) if first is not None else None
        if first is None or found is None or first.parent.parent is not item:
            return
        if any(before.astext() for before in first.parent.children[: first.parent.index(first)]):
            return
        key = found[1]
        first.parent.remove(first)
        definition = nodes.citation(
            "", nodes.label("", key), *item.children, ids=[key.lower()], names=[key]
        )
        definition.source, definition.line = item.source, item.line
        item.replace_self(definition)

    def _refer(self, text: nodes.Text) -> None:
        if isinstance(
            text.parent,
            nodes.literal
            | nodes.literal_block
            | nodes.label
            | nodes.raw
            | nodes.math
            | nodes.math_block,
        ):
            return
        parts = _KEY.split(text)
        if len(parts) == 1:
            return
        new: list[nodes.Node] = []
        for i, part in enumerate(parts):
            if i % 2:
                new.append(nodes.citation_reference("", part, refname=part))
            elif part:
                new.append(nodes.Text(part))
        for node in new:
            if isinstance(node, nodes.Element):
                node.source, node.line = text.parent.source, text.parent.line
        text.parent.replace(text, new)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the transform."""
    app.add_transform(Citations)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
