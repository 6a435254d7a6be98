"""Values as text and as HTML, read back by others."""

from html.parser import HTMLParser

import pytest

from steelyard.display import Display, printable

SHOWN = Display(
    "a <title>",
    (("mass", "kg", "161.2", "0.4"), ("inertia xx", "kg m²", "95.2", "10.0")),
    ("", "unit", "value", "1-sigma"),
    ("One sentence.",),
)


def test_columns_of_text_are_aligned():
    title, head, first, second, sentence = SHOWN.text().split("\n")
    assert (title, sentence) == ("a <title>", "One sentence.")
    assert len(head) == len(first) == len(second)
    # Words begin in one column, numbers end in one.
    assert first.index("kg") == second.index("kg") == head.index("unit")
    assert first.index("161.2") + 5 == second.index("95.2") + 4 == head.index("value") + 5


class Cells(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_data(self, data):
        self.found.append(data)


def test_html_holds_the_same_cells_and_no_markup_of_its_texts():
    cells = Cells()
    cells.feed(SHOWN.html())
    expected = [SHOWN.title, *SHOWN.head, *(cell for row in SHOWN.rows for cell in row)]
    assert cells.found == [each for each in [*expected, *SHOWN.sentences] if each]
    assert "<title>" not in SHOWN.html()


@pytest.mark.parametrize("text", ["a\x1b[2Jb", "a\nb", "a\u202eb", "\x00", "ä ☃"])
def test_nothing_steers_a_terminal(text):
    shown = printable(text)
    assert shown.isprintable()
    kept = [c for c in text if c.isprintable() or c == "\n"]
    assert [" " if c == "\n" else c for c in kept] == [c for c in shown if c != "\ufffd"]
