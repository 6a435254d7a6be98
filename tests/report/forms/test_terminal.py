"""Documents in a terminal: nothing is lost where it is narrow, and nothing of a file steers it."""

import re

import pytest
from rich.console import Console

from steelyard.digits import LABELS, SHORT_LABELS
from steelyard.report.blocks.document import Document, Figure, Grid, Section, Statement, Statements
from steelyard.report.blocks.parameter_grid import ParameterTexts, parameter_grid
from steelyard.report.forms import terminal


def printed(capsys, monkeypatch, document, width=160):
    monkeypatch.setenv("COLUMNS", str(width))
    terminal.show(document)
    return capsys.readouterr().out


def document_of(*blocks):
    return Document("title", Statement("The result.", "good"), (Section("a", "A", blocks),))


def methods(count):
    """A table of so many methods with their errors; every text is unlike the others."""
    columns = []
    for j in range(count):
        values = [f"{i}.{j}0 ± 0.25" for i in range(len(LABELS))]
        errors = [f"+{i}.{j}7" for i in range(len(LABELS))]
        columns.append(ParameterTexts(f"method-{j}, six axes ± 1-sigma", values))
        columns.append(ParameterTexts("error", errors, secondary=True))
    return parameter_grid("all methods", columns)


def test_the_ten_parameters_have_one_shape():
    grid = methods(2)
    assert grid.head == (
        "",
        "unit",
        "method-0, six axes ± 1-sigma",
        "error",
        "method-1, six axes ± 1-sigma",
        "error",
    )
    assert [row[:2] for row in grid.rows] == [
        (name, unit) for name, (_, unit, _) in zip(SHORT_LABELS, LABELS, strict=True)
    ]
    assert grid.right == {2, 3, 4, 5}
    assert grid.secondary == {3, 5}
    assert grid.ruled == {0, 3}


@pytest.mark.parametrize("width", [80, 100, 160])
def test_a_wide_table_is_split_and_nothing_is_lost(capsys, monkeypatch, width):
    grid = methods(6)
    out = printed(capsys, monkeypatch, document_of(grid), width)
    assert max(map(len, out.splitlines())) <= width
    for row in grid.rows:
        for text in row[2:]:
            assert out.count(text) == 1
    # Every part has the names of its rows, and a value has its error beside it.
    parts = out.count("cog x")
    assert out.count("all methods") == 1
    assert parts > 1 or width == 160
    for line in out.splitlines():
        if line.startswith("mass"):
            cells = re.split(r"  +", line)
            values, errors = cells[2::2], cells[3::2]
            assert [each[2] for each in values] == [each[3] for each in errors]


def test_the_first_part_is_as_full_as_it_can_be(capsys, monkeypatch):
    out = printed(capsys, monkeypatch, document_of(methods(7)), 130)
    counts = [line.count("±") for line in out.splitlines() if line.startswith("mass")]
    assert sum(counts) == 7
    assert all(count == counts[0] for count in counts[:-1])
    assert counts[-1] <= counts[0]


STREAMS = Grid(
    "Streams",
    ("run", "instrument", "samples", "rate [Hz]", "jitter [ms]", "dropped", "late", "gaps", "what"),
    (
        ("multisine", "commanded-by-the-winches", "16660", "833.3", "0.0015", "12", "3", "1", "ends"),
        ("t1", "imu", "500", "25", "< 0.001", "-", "-", "-", "is not identifiable from this motion"),
    ),
    frozenset(range(2, 8)),
)  # fmt: skip


@pytest.mark.parametrize("width", [40, 60, 80, 100, 160])
def test_no_number_and_no_word_is_cut(capsys, monkeypatch, width):
    out = printed(capsys, monkeypatch, document_of(STREAMS), width)
    assert max(map(len, out.splitlines())) <= width
    assert "…" not in out
    for row in STREAMS.rows:
        for cell in row[2:8]:
            assert re.search(rf"(?:^|\s){re.escape(cell)}(?:\s|$)", out)
    for word in ["is", "not", "identifiable", "from", "this", "motion"]:
        assert word in out


def test_where_no_column_fits_rows_are_blocks(capsys, monkeypatch):
    grid = Grid("t", ("name", "number"), (("a-long-name-of-a-row", "123456.7890"),), frozenset({1}))
    out = printed(capsys, monkeypatch, document_of(grid), 22)
    assert (
        out.splitlines()[-2:]
        == ["name: a-long-name-of-", "    a-row", "  number: 123456.7890"][-2:]
    )


def test_a_number_stays_beside_its_uncertainty(capsys, monkeypatch):
    said = Statements((Statement(f"{'x' * 30} 118.74 ± 0.80 kg"),))
    out = printed(capsys, monkeypatch, document_of(said), 40)
    assert "118.74 ± 0.80 kg" in out.splitlines()


def test_a_terminal_of_ascii_has_likenesses(capsys, monkeypatch):
    monkeypatch.setattr(Console, "encoding", property(lambda _: "ascii"))
    grid = Grid("a table", ("", "unit", "value"), (("Jxx", "kg m²", "1.0 ± 0.2"),), frozenset({2}))
    said = Statements((Statement("ends … at 3°"),))
    out = printed(capsys, monkeypatch, document_of(grid, said), 80)
    assert out.isascii()
    assert "Jxx   kg m^2  1.0 +/- 0.2" in out or "Jxx  kg m^2  1.0 +/- 0.2" in out
    assert "ends ... at 3deg" in out


def test_result_tables_sentences_and_no_pictures(capsys, monkeypatch):
    grid = Grid("a table", ("name", "number"), (("a", "1"),), frozenset({1}))
    empty = Grid("an empty one", ("name", "number"), ())
    said = Statements((Statement("First.", "bad"), Statement("Second.")))
    figure = Figure("f", "a picture", "nothing", (), {})
    out = printed(capsys, monkeypatch, document_of(said, grid, empty, figure))
    places = [out.index(text) for text in ("The result.", "a table", "First.", "Second.")]
    assert places == sorted(places)
    assert "picture" not in out
    assert "an empty one" not in out


def test_nothing_of_a_file_steers_the_terminal(capsys, monkeypatch):
    hostile = "\x1b[31mred\x07\r\n"
    grid = Grid(hostile, (hostile,), ((hostile,),))
    out = printed(capsys, monkeypatch, document_of(grid, Statements((Statement(hostile),))))
    assert not set(out) & {"\x1b", "\x07", "\r"}
    assert out.count("red") == 4


def test_tones_and_marks_are_colours(capsys, monkeypatch):
    monkeypatch.setattr(
        terminal, "Console", lambda **given: Console(force_terminal=True, width=80, **given)
    )
    marked = [i == 0 for i in range(len(LABELS))]
    grid = parameter_grid("t", [ParameterTexts("z", ["9.9"] * len(LABELS), marked=marked)])
    terminal.show(document_of(grid, Statements((Statement("bad", "bad"),))))
    out = capsys.readouterr().out
    assert out.count("\x1b[31m9.9") == 1
    assert "\x1b[31mbad" in out
    assert "\x1b[32mThe result." in out


def test_a_table_in_a_terminal_holds_its_texts_as_they_are():
    grid = Grid("caption", ("name", "value"), (("[red]a", "1.5"), ("b", "22")), right=(1,))
    console = Console(width=60)
    with console.capture() as captured:
        console.print(terminal.drawn_grid(grid, 60))
    lines = captured.get().splitlines()
    assert lines[0].strip() == "caption"
    assert any("[red]a" in line for line in lines)
    first, second = (next(line for line in lines if text in line) for text in ("1.5", "22"))
    assert first.index("1.5") + 3 == second.index("22") + 2
