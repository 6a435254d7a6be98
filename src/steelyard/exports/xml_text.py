"""Elements as the text of an XML file, with a comment at its top."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree


def xml_text(root: ElementTree.Element, comment: Sequence[str]) -> str:
    """The text of a file.

    Args:
        root: Its element; indented by this.
        comment: Lines of any text that can be printed.
    """
    ElementTree.indent(root)
    lines = "".join(f"  {_inside_comment(line)}\n" for line in comment)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<!--\n{lines}-->\n{body}\n'


def _inside_comment(line: str) -> str:
    """Two hyphens would end the comment; a third may stand behind each two."""
    while "--" in line:
        line = line.replace("--", "- -")
    return line
