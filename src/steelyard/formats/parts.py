"""What schemas are built of: numbers that may be null, bodies, covariances, verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from steelyard.inertia import BODY_PARAMETERS

Schema = dict[str, Any]

TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
KNOWN: Schema = {"type": "number"}
COUNT: Schema = {"type": "integer", "minimum": 0}
NUMBER: Schema = {"type": ["number", "null"]}
"""Null where the data cannot give it."""
ANYTHING: Schema = {"type": "object"}
"""Of which only names of a run, an instrument or a test are keys."""
HASH: Schema = {"type": "string", "pattern": "^[0-9a-f]{64}$"}


def list_of(items: Schema, count: int | None = None) -> Schema:
    """A list, of a fixed length where one is given."""
    length = {} if count is None else {"minItems": count, "maxItems": count}
    return {"type": "array", "items": items, **length}


def named(values: Schema) -> Schema:
    """A mapping from names that are not ours."""
    return {"type": "object", "additionalProperties": values}


def entry(needed: Mapping[str, Schema], further: Mapping[str, Schema] | None = None) -> Schema:
    """A mapping of named keys; later versions may add others.

    Args:
        needed: Keys that are always there.
        further: Keys that may be there.
    """
    return {
        "type": "object",
        "properties": {**needed, **(further or {})},
        "required": list(needed),
    }


def or_null(values: Schema) -> Schema:
    """The same, or null."""
    return {"anyOf": [values, {"type": "null"}]}


def one_of(*values: str) -> Schema:
    """One of a few words."""
    return {"enum": list(values)}


TEXTS = list_of(TEXT)
THREE = list_of(NUMBER, 3)
POINTS = list_of(THREE)
KNOWN_THREE = list_of(KNOWN, 3)
MATRIX = list_of(list_of(NUMBER))
POSE = entry({"position": KNOWN_THREE, "rpy_deg": KNOWN_THREE})

BODY_KEYS: Mapping[str, Schema] = {
    "mass": NUMBER,
    "center_of_gravity": THREE,
    "inertia": list_of(THREE, 3),
}
"""[kg], [m], [kg m^2] about the centre of gravity, in platform axes."""
BODY = entry(BODY_KEYS)
KNOWN_BODY = entry(
    {"mass": KNOWN, "center_of_gravity": KNOWN_THREE, "inertia": list_of(KNOWN_THREE, 3)}
)
TEN = entry(dict.fromkeys(BODY_PARAMETERS, NUMBER))
"""The ten by name."""
COVARIANCE = entry({"parameters": TEXTS, "matrix": MATRIX})
FOUND_ERRORS = named(ANYTHING)
"""Instrument -> calibration parameter -> ``value`` and ``standard_deviation``."""
VALUE: Mapping[str, Schema] = {"value": {}, "standard_deviation": {}}
VERDICT = entry(
    {"accepted": {"type": ["boolean", "null"]}, "reasons": TEXTS},
    {"parameters": named(TEXT), "disagreement": TEXT},
)
HASHED = list_of(entry({"file": TEXT, "sha256": HASH, "bytes": COUNT}))
"""Files with what they held."""
ORIGIN = entry({"versions": named(TEXT), "inputs": HASHED})
"""What a result was made of."""
