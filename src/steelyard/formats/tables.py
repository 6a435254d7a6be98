"""Schemas of tables: of a row of each, as a mapping from columns to values."""

from __future__ import annotations

from steelyard.formats.parts import (
    FLAG,
    KNOWN,
    NUMBER,
    TEXT,
    Schema,
    entry,
    list_of,
    named,
    or_null,
)
from steelyard.formats.results import STATUS
from steelyard.inertia import BODY_PARAMETERS

_TEN: dict[str, Schema] = {
    **dict.fromkeys(BODY_PARAMETERS, NUMBER),
    **{f"sigma_{name}": NUMBER for name in BODY_PARAMETERS},
}
_TEXT = or_null(TEXT)

CAMPAIGN_ROW = entry(
    {
        "experiment": TEXT,
        "path": TEXT,
        "sha256": _TEXT,
        "method": TEXT,
        "status": STATUS,
        **_TEN,
        "covariance": or_null(list_of(NUMBER, 100)),
        "accepted": or_null(FLAG),
        "reason": _TEXT,
        "seconds": NUMBER,
        "version": _TEXT,
        "asked": TEXT,
        "recorded": NUMBER,
    }
)

RECORD_ROW = entry({"run": TEXT, "t": KNOWN, **_TEN})

_PLACE = ("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az", "wx", "wy", "wz")
_TURN = ("alpha_x", "alpha_y", "alpha_z")
MOTION_ROW = entry({"run": TEXT, "t": KNOWN, **dict.fromkeys((*_PLACE, *_TURN), NUMBER)})

STREAM_ROW = named(NUMBER)
"""Columns of the kind of the instrument, which the footer names, in SI."""
