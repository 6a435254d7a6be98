"""What a page says of a document, read by others than those who wrote it: parsers of HTML and
JSON, NumPy, formulas of colour."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest
from documents import TIME, heat, hostile, lines, sample, table, view

from steelyard.report.blocks.document import Document, Figure, Section, Statement
from steelyard.report.forms.figure_json import figure_json
from steelyard.report.forms.page import page

ONLY_TEXT = Document("t", Statement("all is well", "good"), (Section("a", "A", (table(),)),))


class Tree(HTMLParser):
    """Elements of a page with their text."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements = []
        self._open = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), []))
        if tag not in {"meta", "input", "br"}:
            self._open.append(self.elements[-1])

    def handle_endtag(self, tag):
        assert self._open.pop()[0] == tag

    def handle_data(self, data):
        for _, _, text in self._open:
            text.append(data)

    def all(self, tag, **wanted):
        return [
            (attrs, "".join(text))
            for name, attrs, text in self.elements
            if name == tag and all(attrs.get(k) == v for k, v in wanted.items())
        ]


@pytest.fixture(scope="module")
def text():
    return page(sample())


@pytest.fixture(scope="module")
def tree(text):
    return Tree(text)


def scripts(tree):
    return [text for attrs, text in tree.all("script") if "type" not in attrs]


class TestPage:
    def test_same_input_same_bytes(self, text):
        assert page(sample()) == text

    def test_is_one_file_of_bounded_size(self, text, tree):
        assert len(text.encode()) < 5.2e6
        assert all("src" not in attrs for _, attrs, _ in tree.elements)
        assert not tree.all("link")
        assert all(attrs["href"].startswith("#") for attrs, _ in tree.all("a"))

    def test_without_figures_has_no_scripts(self):
        tree = Tree(page(ONLY_TEXT))
        assert not tree.all("script")
        assert (
            "script-src 'none'"
            in tree.all("meta", **{"http-equiv": "Content-Security-Policy"})[0][0]["content"]
        )

    def test_policy_knows_these_scripts_only(self, tree):
        policy = tree.all("meta", **{"http-equiv": "Content-Security-Policy"})[0][0]["content"]
        rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
        assert rules["default-src"] == "'none'"
        known = {
            f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
            for s in scripts(tree)
        }
        assert set(rules["script-src"].split()) == known
        assert len(known) == 3

    def test_sections_headings_and_links(self, tree):
        assert [text for _, text in tree.all("h1")] == [sample().title]
        assert [text for _, text in tree.all("h2")] == [
            section.title for section in sample().sections
        ]
        ids = [attrs["id"] for _, attrs, _ in tree.elements if "id" in attrs]
        assert len(ids) == len(set(ids))
        assert {attrs["href"][1:] for attrs, _ in tree.all("a")} <= set(ids)
        assert tree.all("html")[0][0]["lang"] == "en"

    def test_tables_say_what_cells_belong_to(self, tree):
        grid = table()
        assert [text for _, text in tree.all("th", scope="col")] == [
            cell for cell in grid.head if cell
        ]
        assert [text for _, text in tree.all("th", scope="row")] == [row[0] for row in grid.rows]
        assert [text for _, text in tree.all("td") if text] == [
            cell for row in grid.rows for cell in row[1:]
        ]
        (region,) = tree.all("div", role="region")
        assert (region[0]["tabindex"], region[0]["aria-label"]) == ("0", grid.caption)

    def test_every_picture_has_words(self, tree):
        pictures = tree.all("div", role="img")
        assert len(pictures) == len(tree.all("figcaption")) == len(tree.all("noscript")) == 4
        assert (
            pictures[1][0]["aria-label"]
            == "Residuals of the forces. Eight noisy lines about zero, one per cable."
        )

    def test_tones_have_words(self, tree):
        said = [text.strip() for _, text in tree.all("li")]
        assert [text[:13] for text in said[3:6]] == [
            "✓good: maximu",
            "✗problem: two",
            "!note: the cl",
        ]

    def test_hostile_names_are_text(self):
        document, names = hostile()
        tree = Tree(page(document))
        assert len(scripts(tree)) == 3
        assert not tree.all("img")
        assert tree.all("h1")[0][1] == tree.all("title")[0][1] == " ".join(names)
        assert [text for _, text in tree.all("th", scope="row")] == names
        assert [text for _, text in tree.all("option")] == names
        for _, text in tree.all("script", type="application/json"):
            assert not re.search("[<>&\u2028\u2029]", text)
            json.loads(text)

    def test_what_is_no_character_can_be_written(self):
        strange = replace(ONLY_TEXT, title="run \udcff")
        assert "run ?" in page(strange).encode("utf-8").decode("utf-8")


def strings(value):
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from strings(each)
    elif isinstance(value, list):
        for each in value:
            yield from strings(each)


def unpacked(value, arrays):
    packed = arrays[value["$"]]
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<" + packed["dtype"])


class TestFigureJson:
    def test_long_arrays_are_single_precision_and_there_once(self):
        figure = lines()
        values = json.loads(figure_json(figure))
        assert len(values["arrays"]) == 9
        for trace, given in zip(values["data"], figure.data, strict=True):
            np.testing.assert_allclose(unpacked(trace["x"], values["arrays"]), TIME, rtol=1e-6)
            np.testing.assert_allclose(
                unpacked(trace["y"], values["arrays"]), given["y"], rtol=1e-6
            )

    def test_lists_and_arrays_are_the_same(self):
        figure = lines()
        data = tuple(
            {**trace, "x": trace["x"].tolist(), "y": tuple(trace["y"])} for trace in figure.data
        )
        assert figure_json(replace(figure, data=data)) == figure_json(figure)

    def test_what_single_precision_would_spoil_is_double(self):
        x = 1.7e9 + np.arange(100) * 0.01
        values = json.loads(figure_json(Figure("a", "a", "a", ({"x": x},), {})))
        np.testing.assert_array_equal(unpacked(values["data"][0]["x"], values["arrays"]), x)

    def test_what_single_precision_cannot_hold_is_double(self):
        values = json.loads(
            figure_json(Figure("a", "a", "a", ({"x": np.geomspace(1, 1e200, 30)},), {}))
        )
        np.testing.assert_array_equal(
            unpacked(values["data"][0]["x"], values["arrays"]), np.geomspace(1, 1e200, 30)
        )

    def test_gaps(self):
        y = [None, 1.5, float("nan"), float("inf")] * 10
        values = json.loads(figure_json(Figure("a", "a", "a", ({"x": y[:4], "y": y},), {})))
        assert values["data"][0]["x"] == [None, 1.5, None, None]
        found = unpacked(values["data"][0]["y"], values["arrays"])
        np.testing.assert_array_equal(found, np.tile([np.nan, 1.5, np.nan, np.nan], 10))

    def test_matrices_have_a_shape(self):
        values = json.loads(figure_json(heat()))
        assert values["arrays"][0]["shape"] == "10, 10"

    def test_courses(self):
        scene = view()
        values = json.loads(figure_json(scene))
        for course, given in zip(values["courses"], scene.courses, strict=True):
            for name in ("time", "position", "rotation"):
                packed = course[name]
                found = packed if isinstance(packed, list) else unpacked(packed, values["arrays"])
                np.testing.assert_allclose(found, np.ravel(getattr(given, name)), atol=1e-6)
        assert values["data"][0]["meta"]["moves"] == [False, True]

    def test_no_text_is_markup(self):
        document, _ = hostile()
        flat, scene = document.sections[0].blocks[2:]
        for each in strings(json.loads(figure_json(flat))):
            assert not re.search(r"<|&(?!amp;|lt;|gt;)", each), each
        for each in strings(json.loads(figure_json(scene))["layout"]):
            assert not re.search(r"[<&](?!\u200b)", each), each

    def test_templates_keep_their_breaks_only(self):
        data = {"hovertemplate": "<b>%{y}</b><br>x<extra></extra>", "text": "two\nlines"}
        (trace,) = json.loads(figure_json(Figure("a", "a", "a", (data,), {})))["data"]
        assert trace == {
            "hovertemplate": "&lt;b&gt;%{y}&lt;/b&gt;<br>x<extra></extra>",
            "text": "two<br>lines",
        }

    def test_titles_may_be_bare(self):
        values = json.loads(figure_json(Figure("a", "a", "a", (), {"xaxis": {"title": "t [s]"}})))
        assert values["layout"] == {"xaxis": {"title": {"text": "t [s]"}}}

    def test_what_is_no_value_is_refused(self):
        with pytest.raises(
            TypeError, match="'x': expected text, a number, a list or a mapping, found set"
        ):
            figure_json(Figure("a", "a", "a", ({"x": {1}},), {}))


STYLE = (files("steelyard.report.forms") / "web" / "page.css").read_text(encoding="utf-8")
_LIGHT, _DARK = (
    {name: np.array([int(hexa[i : i + 2], 16) / 255 for i in (0, 2, 4)]) for name, hexa in re.findall(r"--([a-z0-9-]+): #([0-9a-f]{6});", part)}
    for part in re.findall(r":root(?:\S*) \{(.*?)\n *\}", STYLE, flags=re.DOTALL)
)  # fmt: skip
SCHEMES = {"light": _LIGHT, "dark": {**_LIGHT, **_DARK}}
LINES = [f"line-{i + 1}" for i in range(8)]


def linear(colour):
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def contrast(a, b):
    """WCAG 2.2."""
    low, high = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (a, b))
    return (high + 0.05) / (low + 0.05)


# Machado, Oliveira, Fernandes (2009), severity 1: protanopia, deuteranopia, tritanopia, on linear
# RGB.
BLINDNESS = {
    "none": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}


def oklab(rgb):
    """Ottosson (2020), of linear RGB."""
    to_cones = [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
    to_lab = [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
    return np.array(to_lab) @ np.cbrt(np.array(to_cones) @ np.clip(rgb, 0, 1))


@pytest.mark.parametrize("scheme", SCHEMES)
class TestColours:
    def test_text_is_readable(self, scheme):
        colours = SCHEMES[scheme]
        assert set(colours) == set(_LIGHT)
        pairs = [
            (text, ground)
            for text in ("ink", "muted", "accent", "good", "bad", "note")
            for ground in ("ground", "raised")
        ]
        pairs += [
            (text, f"{tone}-ground") for tone in ("good", "bad", "note") for text in ("ink", tone)
        ]
        for text, ground in pairs:
            assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)

    def test_lines_stand_out(self, scheme):
        for line in LINES:
            assert contrast(SCHEMES[scheme][line], SCHEMES[scheme]["ground"]) >= 3, line

    @pytest.mark.parametrize("blindness", BLINDNESS)
    def test_lines_differ(self, scheme, blindness):
        """Two hundredths are just noticeable, side by side."""
        seen = {
            line: oklab(np.array(BLINDNESS[blindness]) @ linear(SCHEMES[scheme][line]))
            for line in LINES
        }
        for a, b in combinations(LINES, 2):
            assert np.linalg.norm(seen[a] - seen[b]) > 0.09, (a, b)
