"""The pictures of the report as Plotly figures, for notebooks."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.identification.identification import Identification
from steelyard.inertia import Inertia
from steelyard.report.blocks.document import Figure, Replay, Scene, flat
from steelyard.report.documents.identification import document_of
from steelyard.report.evidence.summary import summarise
from steelyard.report.forms.page import palette

if TYPE_CHECKING:
    import plotly.graph_objects as go


def figures(found: Identification, truth: Inertia | None = None) -> dict[str, go.Figure]:
    """All pictures of the report of an identification.

    Args:
        found: As :func:`steelyard.identify` gives it.
        truth: The true body, where it is known.

    Returns:
        Figures under the names ``intervals``, ``robot``, ``body``, ``learned``, ``correlation``,
        and ``trace-…`` and ``spectra-…`` of every run.
    """
    return {name: _plotly(block) for name, block in _pictures(found, truth).items()}


def figure(found: Identification, name: str, truth: Inertia | None = None) -> go.Figure:
    """One picture of the report of an identification.

    Args:
        found: As :func:`steelyard.identify` gives it.
        name: ``intervals``, ``robot``, ``body``, ``learned``, ``correlation``, or the beginning of
            another key of :func:`figures`.
        truth: The true body, where it is known.

    Raises:
        InputError: There is none of that name.
    """
    pictures = _pictures(found, truth)
    chosen = next((each for each in pictures if each.startswith(name)), None)
    if name in pictures:
        chosen = name
    if chosen is None or not name:
        raise InputError(
            f"figure: expected one of {', '.join(pictures)}, found '{name}'; choose one of these"
        )
    return _plotly(pictures[chosen])


def _pictures(found: Identification, truth: Inertia | None) -> dict[str, Figure | Scene]:
    """Name -> picture of the report."""
    pictures: dict[str, Figure | Scene] = {}
    for section in document_of(summarise(found, truth)).sections:
        for block in flat(section.blocks):
            if isinstance(block, Scene):
                pictures[block.figure.name] = block
            elif isinstance(block, Figure):
                pictures[block.name] = block
    return pictures


def _plotly(block: Figure | Scene) -> go.Figure:
    """A picture for a notebook, in the colours of the page."""
    import plotly.graph_objects as go

    colours = palette()
    drawn = block.figure if isinstance(block, Scene) else block
    data = [dict(trace) for trace in drawn.data]
    if isinstance(block, Scene) and block.courses:
        data = [_placed(trace, block.courses[0]) for trace in data]
    layout = {
        **_dressed(drawn.layout, colours),
        "height": drawn.height,
        "template": "plotly_white",
        "title": {"text": html.escape(drawn.title), "font": {"size": 14}},
    }
    return go.Figure([_dressed(trace, colours) for trace in data], layout)


def _placed(trace: dict[str, Any], course: Replay) -> dict[str, Any]:
    """Points that move, where they are at the beginning of a course."""
    moves = np.array(trace["meta"]["moves"], dtype=bool)
    points = np.stack([np.asarray(trace[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    turn = Rotation.from_quat(course.rotation[0], scalar_first=True)
    points[moves] = turn.apply(points[moves]) + course.position[0]
    return {**trace, **dict(zip("xyz", points.T, strict=True))}


def _dressed(value: Any, colours: Mapping[str, str]) -> Any:
    """Colours as they are, text as text: Plotly would take some for markup."""
    if isinstance(value, Mapping):
        return {key: _dressed(each, colours) for key, each in value.items() if key != "meta"}
    if isinstance(value, list | tuple):
        return [_dressed(each, colours) for each in value]
    if isinstance(value, str):
        return (
            colours[value[6:-1]] if value.startswith("var(--") else html.escape(value, quote=False)
        )
    return value
