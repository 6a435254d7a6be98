"""XML that others parse, whatever stands in its comment."""

from xml.etree import ElementTree

import pytest

from steelyard.exports.xml_text import xml_text


@pytest.mark.parametrize(
    "line", ["plain", "a -- b", "---", "-->", "<!-- x -->", "- -", "&amp; <a>"]
)
def test_a_comment_stays_a_comment(line):
    root = ElementTree.Element("robot", name='a "b" <c>')
    ElementTree.SubElement(root, "link").text = "1 < 2"
    text = xml_text(root, ["first", line])
    parsed = ElementTree.fromstring(text)
    assert parsed.get("name") == 'a "b" <c>'
    assert [child.tag for child in parsed] == ["link"]
    assert parsed[0].text == "1 < 2"
    comment = text[text.index("<!--") + 4 : text.index("\n-->\n")]
    assert "--" not in comment.replace("<!--", "")


def test_the_comment_keeps_what_it_says():
    text = xml_text(ElementTree.Element("a"), ["mass 3 kg"])
    assert text.startswith('<?xml version="1.0" encoding="UTF-8"?>\n<!--\n  mass 3 kg\n-->\n')
