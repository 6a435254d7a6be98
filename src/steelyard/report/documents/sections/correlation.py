"""How the errors of the ten parameters go together."""

from __future__ import annotations

import numpy as np

from steelyard.digits import SHORT_LABELS, fixed
from steelyard.report.blocks.document import Figure, Grid, Section, Statement, Statements
from steelyard.report.blocks.plot import NAMES_DOWNWARDS
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import EstimatedBody

_STRONG = 0.8
"""Correlations that are named in words: the two share two thirds of their variance."""


def correlation(summary: Summary) -> Section | None:
    """The section; None where less than two parameters are identifiable."""
    names, matrix = _matrix(summary.best)
    if len(names) < 2:
        return None
    text = (
        "How the errors of the parameters are correlated: near 1 or -1, the data determine a"
        " combination of two parameters better than each of them."
    )
    strong = [
        Statement(f"{a} and {b}: {fixed(matrix[i][j], 2, sign=True)}", "note")
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
        if abs(matrix[i][j]) > _STRONG
    ]
    rows = tuple(
        (name, *(fixed(v, 2, sign=True) for v in row))
        for name, row in zip(names, matrix, strict=True)
    )
    data = (
        {
            "type": "heatmap",
            "x": names,
            "y": names,
            "z": matrix.tolist(),
            "zmin": -1,
            "zmax": 1,
            "zmid": 0,
            "colorscale": "RdBu",
            "reversescale": True,
            "hoverongaps": False,
            "colorbar": {"title": {"text": "correlation"}},
        },
    )
    layout = {
        "yaxis": NAMES_DOWNWARDS,
        "xaxis": {"type": "category"},
    }
    figure = Figure(
        "correlation",
        f"Correlation of the parameters, {summary.result}",
        "The same numbers as in the table below, as colours.",
        data,
        layout,
        height=460,
    )
    grid = Grid("Correlation", ("", *names), rows, frozenset(range(1, len(names) + 1)))
    return Section(
        "correlation",
        "Correlation of the parameters",
        (Statements((Statement(text), *strong)), figure, grid),
    )


def _matrix(body: EstimatedBody) -> tuple[list[str], np.ndarray]:
    """Names of the p parameters with an uncertainty, and their correlations, shape (p, p)."""
    covariance = np.array(
        [[np.nan if v is None else v for v in row] for row in body.covariance], dtype=np.float64
    )
    known = np.flatnonzero(np.diag(covariance) > 0)
    sigma = np.sqrt(np.diag(covariance)[known])
    found = covariance[np.ix_(known, known)] / np.outer(sigma, sigma)
    names = [SHORT_LABELS[i] for i in known]
    return names, np.round(np.clip(np.nan_to_num(found), -1.0, 1.0), 4)
