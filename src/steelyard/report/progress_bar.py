"""How far a call from Python has come, shown in a notebook of Jupyter or marimo."""

from __future__ import annotations

import html
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from time import monotonic
from typing import Any

from steelyard.display import printable, time_left

_PAUSE = 0.1
"""Between two pictures of the bar [s]: a browser needs no more."""

Show = Callable[[str], None]
"""Puts HTML in the place of what it put before; empty text takes it away."""


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """One bar in the output of a cell, with the time that is left where that can be told; it goes
    when the work is done.

        >>> with steelyard.progress_bar() as progress:
        ...     found = steelyard.identify(experiment, progress=progress)

    In Jupyter and in marimo; elsewhere a line on stderr for each thing that is done.

    Returns:
        What is handed over as ``progress``: is told what is being done and the fraction that is
        done.
    """
    show = _marimo() or _jupyter()
    if show is None:
        yield tell_in_lines()
        return
    begun, shown, done = monotonic(), -_PAUSE, 0.0

    def tell(what: str, fraction: float) -> None:
        nonlocal shown, done
        # Parts that begin again, such as a fit that is tried twice, do not take anything back.
        done = max(done, min(1.0, fraction))
        elapsed = monotonic() - begun
        if elapsed - shown >= _PAUSE:
            shown = elapsed
            show(_bar(what, done, time_left(done, elapsed)))

    show(_bar("", 0.0, ""))
    try:
        yield tell
    finally:
        show("")


def _bar(what: str, done: float, left: str) -> str:
    """The bar as HTML, without colours of its own."""
    words = html.escape(" · ".join(filter(None, (printable(what), left))))
    return (
        f'<div><progress max="1" value="{done:.3f}"></progress> {100 * done:.0f} %'
        f"{' ' + words if words else ''}</div>"
    )


def _marimo() -> Show | None:
    """The output of the cell of marimo that is running; None: this is no notebook of it."""
    marimo: Any = sys.modules.get("marimo")
    if marimo is None or not marimo.running_in_notebook():
        return None

    def show(text: str) -> None:
        if text:
            marimo.output.replace(marimo.Html(text))
        else:
            marimo.output.clear()

    return show


def _jupyter() -> Show | None:
    """A place below the cell of Jupyter that is running; None: this is no notebook of it."""
    shell: Any = sys.modules.get("IPython")
    running = None if shell is None else shell.get_ipython()
    if running is None or getattr(running, "kernel", None) is None:
        return None
    cell: Any = import_module("IPython.display")
    place = cell.display(cell.HTML(""), display_id=True)
    return lambda text: place.update(cell.HTML(text))


def tell_in_lines() -> Callable[[str, float], None]:
    """What is being done, once each, a line below the other."""
    known: set[str] = set()

    def tell(what: str, fraction: float) -> None:
        if what and what not in known:
            known.add(what)
            sys.stderr.write(f"{printable(what)}\n")
            sys.stderr.flush()

    return tell
