"""Figures as JSON within a page: compact, and all text in it stays text, for the reader of HTML as
for Plotly.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.report.blocks.document import Figure, Replay, Scene

_FEW = 24
"""Numbers that are still written as such."""
_FINE = 1e-5
"""Of the range of an array: what single precision may cost."""
_PLAIN = frozenset({"meta", "colorscale"})
"""Keys whose lists stay lists."""
_DRAWN = frozenset({"text", "title", "ticktext"})
"""Keys whose text 3-D views draw themselves."""
_MARKUP = ("<extra></extra>", "<br>")
"""What a template of hover text may have beside text."""
_WITHIN_SCRIPT = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


def figure_json(block: Figure | Scene) -> str:
    """What a figure or a scene is drawn from, for a script element of type ``application/json``.

    Keys: data, layout, arrays, narrow (layout and height where the window is), and courses of a
    scene, each with time, position (3 n) and rotation (4 n). Long arrays of numbers are
    ``{"$": place in arrays}``, once each; there ``{dtype, bdata, shape}``, little-endian in base64,
    as Plotly takes them. In texts characters that Plotly would take as markup are entities, and an
    end of line is one in the picture.

    Raises:
        TypeError: A value is none of text, number, list, array, mapping and None.
    """
    figure = block.figure if isinstance(block, Scene) else block
    values: dict[str, Any] = {
        "data": [
            _plain(trace, packed=True, drawn="3d" in str(trace.get("type")))
            for trace in figure.data
        ],
        "layout": _layout(figure.layout),
    }
    if figure.narrow is not None:
        values["narrow"] = {
            "layout": _layout(figure.narrow.layout),
            "height": figure.narrow.height,
        }
    if isinstance(block, Scene):
        values["courses"] = [_course(each) for each in block.courses]
    arrays: dict[str, tuple[int, Any]] = {}
    values = _shared(values, arrays)
    values["arrays"] = [packed for _, packed in arrays.values()]
    text = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.translate(_WITHIN_SCRIPT)


def _layout(layout: Mapping[str, Any]) -> dict[str, Any]:
    """Axes, titles and shapes."""
    return {key: _plain(value, key, drawn=key.startswith("scene")) for key, value in layout.items()}


def _course(replay: Replay) -> dict[str, Any]:
    """A motion to replay."""
    return {
        name: _list(np.ravel(getattr(replay, name)), packed=True)
        for name in ("time", "position", "rotation")
    }


def _plain(value: Any, key: str = "", *, packed: bool = False, drawn: bool = False) -> Any:
    """A value for JSON; ``packed``: as bytes where that is shorter; ``drawn``: texts are drawn by
    WebGL.
    """
    if isinstance(value, str):
        text = _unmarked(value) if drawn and key in _DRAWN else _text(value, key)
        # A bare text was a title in former versions of Plotly; it is not any more.
        return {"text": text} if key == "title" else text
    if isinstance(value, Mapping):
        return {
            str(k): _plain(v, str(k), packed=packed and k not in _PLAIN, drawn=drawn)
            for k, v in value.items()
        }
    if isinstance(value, np.ndarray | list | tuple):
        return _list(value, key, packed=packed, drawn=drawn)
    if value is None or isinstance(value, bool | np.bool_):
        return None if value is None else bool(value)
    if isinstance(value, int | float | np.integer | np.floating):
        return _number(float(value))
    raise TypeError(
        f"figure: '{key}': expected text, a number, a list or a mapping, found"
        f" {type(value).__name__}"
    )


def _text(value: str, key: str) -> str:
    text = html.escape(value, quote=False)
    if key.endswith("template"):
        for each in _MARKUP:
            text = text.replace(html.escape(each, quote=False), each)
    return text.replace("\n", "<br>")


def _unmarked(value: str) -> str:
    """Text for WebGL, which knows tags and no entities: a space of no width ends a tag before it
    begins.
    """
    return value.replace("<", "<\u200b").replace("&", "&\u200b").replace("\n", "<br>")


def _number(value: float) -> float | int | None:
    if not np.isfinite(value):
        return None
    short = float(f"{value:.9g}")
    return int(short) if short.is_integer() and abs(short) < 1e9 else short


def _list(values: Any, key: str = "", *, packed: bool, drawn: bool = False) -> Any:
    numbers = _numbers(values) if packed else None
    if numbers is not None and numbers.size >= _FEW:
        return _bytes(numbers)
    return [_plain(each, key, packed=packed, drawn=drawn) for each in values]


def _numbers(values: Any) -> Array | None:
    """Numbers in one or two dimensions, None as NaN; None where they are something else."""
    if not isinstance(values, np.ndarray):
        every = np.array(values, dtype=object)
        if not all(_is_number(value) for value in every.flat):
            return None
        values = every.astype(np.float64)
    if values.dtype.kind not in "iuf" or values.ndim not in (1, 2):
        return None
    return np.where(np.isfinite(values), values, np.nan).astype(np.float64)


def _is_number(value: Any) -> bool:
    """Whether it is a number or None."""
    if value is None:
        return True
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _shared(value: Any, arrays: dict[str, tuple[int, Any]]) -> Any:
    """The same with long arrays, many of them the times of several lines, gathered in
    ``arrays``.
    """
    if isinstance(value, list):
        return [_shared(each, arrays) for each in value]
    if not isinstance(value, dict):
        return value
    if "bdata" in value:
        return {"$": arrays.setdefault(json.dumps(value), (len(arrays), value))[0]}
    return {key: _shared(each, arrays) for key, each in value.items()}


def _bytes(numbers: Array) -> dict[str, str]:
    """An array as Plotly takes it, in single precision where that costs nothing."""
    finite = numbers[np.isfinite(numbers)]
    with np.errstate(over="ignore"):  # beyond single precision all is lost
        single: NDArray[np.float32] = numbers.astype("<f4")
        lost = float(np.max(np.abs(single[np.isfinite(numbers)] - finite), initial=0.0))
    fine = lost <= _FINE * float(np.ptp(finite)) if len(finite) else True
    packed = {"dtype": "f4" if fine else "f8"}
    packed["bdata"] = base64.b64encode(
        (single if fine else numbers.astype("<f8")).tobytes()
    ).decode("ascii")
    if numbers.ndim > 1:
        packed["shape"] = ", ".join(map(str, numbers.shape))
    return packed
