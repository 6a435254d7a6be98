"""What Markdown says of a document."""

import re

import pytest
from documents import hostile, sample

from steelyard.report.blocks.document import Document, Section, Statement, Statements
from steelyard.report.forms.markdown import escaped, markdown


def test_the_whole():
    lines = markdown(sample()).splitlines()
    assert lines[0] == "# cogiro, twenty seconds"
    assert lines[2].startswith("The platform has 161.18 ± 0.38 kg")
    assert [line for line in lines if line.startswith("## ")] == [
        "## Verdict",
        "## Motion",
        "## Residuals",
    ]
    assert "- maximum-likelihood: accepted" in lines
    assert "**All ten parameters**" in lines
    assert (
        "| centre of gravity x | mm | -1 | 32 ± 19 | 2.4 ± 2.0 | -2.4 ± 1.7 | 1.66 | 0.4 |" in lines
    )
    assert "|---|---|---:|---:|---:|---:|---:|---:|" in lines
    assert "*Picture: The robot in motion. A platform on eight cables.*" in lines
    assert markdown(sample()) == "\n".join(lines) + "\n"


def test_hostile_names_are_text():
    document, names = hostile()
    text = markdown(document)
    assert not re.search(r"[<>`]|!\[|\]\(", text)
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in rows} == {len(names) + 2}


@pytest.mark.parametrize("text", ["1. first", "- dash", "+ plus", "12) twelve", "=== rule"])
def test_a_line_is_no_list(text):
    said = Document("t", Statement(text), (Section("a", "A", (Statements((Statement(text),)),)),))
    _, _, lead, _, _, _, bullet = markdown(said).splitlines()
    assert bullet == f"- {lead}"
    assert not re.match(r"[-+=]|\d+[.)]", lead)


def test_ends_of_lines_do_not_end_them():
    assert escaped("a\n\n# b|c") == "a &#35; b&#124;c"
