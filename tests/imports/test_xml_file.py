"""Elements of XML against ElementTree, and what is refused."""

from xml.etree import ElementTree

import pytest

from steelyard.errors import InputError
from steelyard.imports.sources import printable, read_source
from steelyard.imports.xml_file import read_xml

TEXT = """<?xml version="1.0"?>
<robot name="a">
  <cable e="1 2,3"><length> 4.5 </length></cable>
  <cable e="1e400"/>
  tail
</robot>
"""


@pytest.fixture
def written(tmp_path):
    def written(text):
        path = tmp_path / "a.xml"
        path.write_text(text)
        return path

    return written


def same(ours, theirs):
    assert (ours.tag, dict(ours.attributes)) == (theirs.tag, theirs.attrib)
    pieces = [theirs.text, *(child.tail for child in theirs)]
    assert ours.text == "".join(piece or "" for piece in pieces).strip()
    assert len(ours.children) == len(theirs)
    for our, their in zip(ours.children, theirs, strict=True):
        same(our, their)


def test_elements_are_those_of_elementtree(written):
    root = read_xml(written(TEXT))
    same(root, ElementTree.fromstring(TEXT))
    first, second = root.all("cable")
    assert (root.line, first.line, second.line) == (2, 3, 4)
    assert first.numbers_of("e", 3) == (1.0, 2.0, 3.0)
    assert first.child("length").number() == 4.5
    assert root.find("pulley") is None


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lambda root: root.find("cable"), "a.xml:4: 'cable': expected one 'cable' in 'robot'"),
        (lambda root: root.child("pulley"), "a.xml:2: 'robot': expected 'pulley' inside"),
        (lambda root: root.attribute("mass"), "expected the attribute 'mass', found none"),
        (lambda root: root.number(), "expected a number, found 'tail'"),
        (lambda root: root.all("cable")[0].numbers_of("e", 2), "expected 2 numbers"),
        (lambda root: root.all("cable")[1].numbers_of("e", 1), "expected a number, found '1e400'"),
        (lambda root: root.vector(), "expected 3 numbers"),
    ],
)
def test_what_is_missing_is_named_with_its_line(written, question, message):
    root = read_xml(written(TEXT))
    with pytest.raises(InputError, match=message):
        question(root)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<a><b></a>", "a.xml:1: expected XML, found a mistake"),
        (
            '<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>',
            "attribute lists of its own, found '<!DOCTYPE a",
        ),
        (
            "<!DOCTYPE a [" + "".join(f'<!ATTLIST a b{i} CDATA "x">' for i in range(3)) + "]><a/>",
            "of its own",
        ),
        ("<a>" * 70, "64 deep, found more"),
        ('<?xml version="1.0" encoding="nonsense"?><a/>', "encoding"),
    ],
)
def test_hostile_files_are_one_sentence(written, text, message):
    with pytest.raises(InputError, match=message):
        read_xml(written(text))


def test_files_are_known_by_their_content(written, tmp_path):
    assert read_source(written("\n  <a/>")).tag == "a"
    (tmp_path / "b.xml").write_text('{"a": 1}')
    assert read_source(tmp_path / "b.xml").data == {"a": 1}


def test_text_of_files_in_notes():
    assert printable("a\nb\x07") == "a b\ufffd"
    assert len(printable("x" * 100)) == 60
