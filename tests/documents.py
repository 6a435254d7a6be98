"""A document with one of everything, to draw."""

import numpy as np

from steelyard.report.blocks.document import (
    Document,
    Figure,
    Grid,
    Replay,
    Scene,
    Section,
    Statement,
    Statements,
)

TIME = np.linspace(0.0, 20.0, 801)
CORNERS = np.array([[x, y, z] for x in (-4.0, 4.0) for y in (-3.0, 3.0) for z in (0.2, 5.0)])
EDGES = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.4, 0.4)])


def lines(name="residuals", title="Residuals of the forces", names=tuple("12345678")):
    noise = np.random.default_rng(7).normal(size=(len(TIME), len(names)))
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"cable {each}",
            "x": TIME,
            "y": noise[:, i],
            "line": {"width": 1},
        }
        for i, each in enumerate(names)
    ]
    layout = {
        "xaxis": {"title": {"text": "common time [s]"}},
        "yaxis": {"title": {"text": "force [N]"}},
        "shapes": [{"type": "rect", "x0": 4, "x1": 5, "y0": 0, "y1": 1, "yref": "paper", "fillcolor": "var(--bad)", "opacity": 0.2, "line": {"width": 0}}],
        "annotations": [{"text": "contact", "x": 4.5, "y": 1, "yref": "paper", "showarrow": False}],
    }  # fmt: skip
    return Figure(name, title, "Eight noisy lines about zero, one per cable.", tuple(data), layout)


def bars():
    data = {
        "type": "bar", "name": "1-sigma", "x": ["mass", "centre of gravity x", "inertia xx"], "y": [0.38, 1.7, None],
        "hovertext": ["kg", "mm", "kg m²"], "hovertemplate": "%{y}<br>%{hovertext}<extra></extra>",
    }  # fmt: skip
    return Figure(
        "bars",
        "What is known",
        "Three bars.",
        (data,),
        {"yaxis": {"type": "log", "title": "1-sigma"}},
        260,
    )


def heat():
    a = np.outer(np.sin(np.arange(10)), np.cos(np.arange(10)))
    return Figure(
        "heat",
        "Correlation",
        "A matrix.",
        ({"type": "heatmap", "z": a, "zmin": -1, "zmax": 1},),
        {},
        320,
    )


def view():
    """Eight cables on a platform that goes round, on two courses."""
    cables = [
        {
            "type": "scatter3d", "mode": "lines", "name": f"cable {i + 1}", "line": {"width": 4}, "showlegend": False,
            "x": [a[0], e[0]], "y": [a[1], e[1]], "z": [a[2], e[2]], "meta": {"moves": [False, True]},
        }
        for i, (a, e) in enumerate(zip(CORNERS, EDGES, strict=True))
    ]  # fmt: skip
    box = EDGES[[0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4]]
    platform = {
        "type": "scatter3d", "mode": "lines+text", "name": "platform", "x": box[:, 0], "y": box[:, 1], "z": box[:, 2],
        "line": {"color": "var(--ink)", "width": 5}, "meta": {"moves": [True] * len(box)}, "text": ["<b>P</b> & 1", *[""] * 15],
    }  # fmt: skip
    angle = 0.3 * np.sin(TIME)
    position = np.stack([np.cos(TIME), np.sin(TIME), 1.5 + 0 * TIME], axis=1)
    rotation = np.stack([np.cos(angle / 2), 0 * TIME, 0 * TIME, np.sin(angle / 2)], axis=1)
    courses = (
        Replay("round", TIME, position, rotation),
        Replay(
            "up",
            TIME[:2] / 5,
            np.array([[0, 0, 1.0], [0, 0, 3.0]]),
            np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]]),
        ),
    )
    layout = {
        "scene": {
            axis: {"title": {"text": f"{axis[0]} [m] <i>"}} for axis in ("xaxis", "yaxis", "zaxis")
        }
    }
    figure = Figure(
        "robot",
        "The robot in motion",
        "A platform on eight cables.",
        (*cables, platform),
        layout,
        480,
    )
    return Scene(figure, courses)


def table():
    rows = tuple(
        (f"centre of gravity {x}", "mm", "-1", "32 ± 19", "2.4 ± 2.0", "-2.4 ± 1.7", "1.66", "0.4")
        for x in "xyz"
    )
    head = (
        "",
        "unit",
        "truth",
        "two-step on the eight moves",
        "two-step on 20 s, six axes",
        "maximum-likelihood on the same 20 s",
        "attainable 1-sigma",
        "z",
    )
    return Grid("All ten parameters", head, rows, frozenset(range(2, 8)))


def sample():
    verdicts = Statements(
        (
            Statement("maximum-likelihood: accepted", "good"),
            Statement("two-step: not accepted: the residuals of the forces are 3.2 times what their noise explains; the runs disagree", "bad"),
            Statement("the clock of the tracker was found from the data, 4.7 ms late", "note"),
            Statement("`steelyard design` finds a motion that tells more"),
        )
    )  # fmt: skip
    return Document(
        "cogiro, twenty seconds",
        Statement("The platform has 161.18 ± 0.38 kg; all ten parameters are known, and the estimate is accepted.", "good"),
        (
            Section("verdict", "Verdict", (verdicts, table())),
            Section("motion", "Motion", (view(),)),
            Section("residuals", "Residuals", (lines(), bars(), heat())),
        ),
    )  # fmt: skip


def hostile():
    """A document whose names are all markup, and the names."""
    names = [
        "<script>alert(1)</script>", '"><img src=x onerror=alert(2)>', "</script><script>alert(3)</script>",
        '<a href="javascript:alert(4)">run</a>', "</title>&lt;b&gt;\u2028{{ 7 * 7 }}", "<b>bold</b><!-- <script>", "%{x} $x$ <br> 'q' `r`",
    ]  # fmt: skip
    whole = " ".join(names)
    said = Statements(tuple(Statement(name, "bad") for name in names))
    grid = Grid(whole, (whole, *names), tuple((name, *names) for name in names))
    data = tuple(
        {"type": "scatter", "name": n, "x": names, "y": [1, 2, 3, 4, 5, 6, 7], "hovertext": names}
        for n in names
    )
    titles = {"xaxis": {"title": {"text": whole}}, "yaxis": {"title": whole}}
    note = [{"text": name, "x": i, "y": 1} for i, name in enumerate(names)]
    flat = Figure(
        "f", whole, whole, data, {**titles, "annotations": note, "title": {"text": whole}}, 900
    )
    points = {
        "type": "scatter3d", "mode": "markers+text", "name": names[0], "text": names, "hovertext": names,
        "x": [0, 1, 2, 3, 4, 5, 6], "y": [0, 1, 0, 1, 0, 1, 0], "z": [0, 0, 0, 0, 0, 0, 1], "meta": {"moves": [True] * 7},
    }  # fmt: skip
    still = np.zeros((2, 3)), np.array([[1.0, 0, 0, 0]] * 2)
    courses = tuple(Replay(name, np.array([0.0, 1.0]), *still) for name in names)
    scene = Scene(Figure("s", whole, whole, (points,), {"scene": titles}), courses)
    return (
        Document(
            whole, Statement(whole, "note"), (Section("a", whole, (said, grid, flat, scene)),)
        ),
        names,
    )
