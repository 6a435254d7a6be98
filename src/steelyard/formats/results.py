"""Schemas of what was found: estimates, calibrations, comparisons, inspections, lines of
`watch`.
"""

from __future__ import annotations

from steelyard.formats.parts import (
    ANYTHING,
    BODY,
    BODY_KEYS,
    COUNT,
    COVARIANCE,
    FLAG,
    FOUND_ERRORS,
    HASH,
    HASHED,
    KNOWN,
    KNOWN_BODY,
    MATRIX,
    NUMBER,
    ORIGIN,
    POINTS,
    TEN,
    TEXT,
    TEXTS,
    THREE,
    VALUE,
    VERDICT,
    Schema,
    entry,
    list_of,
    named,
    one_of,
    or_null,
)

_MADE: dict[str, Schema] = {
    "calibration": FOUND_ERRORS,
    "residuals": ANYTHING,
    "details": ANYTHING,
    "notes": TEXTS,
    "covariance": COVARIANCE,
    "physical": {"type": ["boolean", "null"]},
    "inertia_per_mass": list_of(THREE, 3),
    "covariance_per_mass": COVARIANCE,
    "geometry": ANYTHING,
    "platform": ANYTHING,
}
_BY_METHOD = {**BODY_KEYS, "standard_deviation": BODY, "verdict": VERDICT}
_ENTRY = entry(_BY_METHOD, _MADE)
_ESTIMATE = entry(
    _BY_METHOD,
    {
        **_MADE,
        "runs": named(ANYTHING),
        "loads": named(_ENTRY),
        "joint": entry({"loads": TEXTS, "matrix": MATRIX}),
        "differences": named(ANYTHING),
    },
)

ESTIMATE = entry(
    {
        "experiment": TEXT,
        "nominal": or_null(KNOWN_BODY),
        "result": TEXT,
        "estimates": named(_ESTIMATE),
    },
    {
        "recordings": named(TEXT),
        "attainable": or_null(ANYTHING),
        "clocks": ANYTHING,
        "holdout": ANYTHING,
        "amendment": TEXT,
        "left_out": TEXTS,
        "provenance": ORIGIN,
    },
)

_MOVED = entry({**dict.fromkeys(VALUE, POINTS), "moved": POINTS})
CALIBRATION = entry(
    {
        "experiment": TEXT,
        "robot": TEXT,
        "anchors": _MOVED,
        "attachments": _MOVED,
        "axial_stiffness": or_null(entry(VALUE)),
        "pulley_radius": or_null(entry(VALUE)),
        "calibration": FOUND_ERRORS,
        "residuals": entry({"in_units_of_noise": named(NUMBER)}, {"leave_one_out": {}}),
        "gauge": TEXTS,
        "unobservable": TEXTS,
        "wrong_rows": TEXTS,
        "notes": TEXTS,
        "verdict": VERDICT,
    },
    {
        "pulley_axis": or_null(entry(VALUE)),
        "body": entry({**BODY_KEYS, "standard_deviation": BODY}),
        "datum": entry(
            {"world_from_described": entry({"translation": entry(VALUE), "rotation": entry(VALUE)})}
        ),
        "provenance": ORIGIN,
    },
)

PROVENANCE = entry(
    {
        "versions": named(TEXT),
        "command": TEXTS,
        "time": TEXT,
        "inputs": HASHED,
        "results": HASHED,
        "sha256": HASH,
    }
)

_TEST = ANYTHING
COMPARISON = entry(
    {
        "estimates": list_of(
            entry(
                {
                    "name": TEXT,
                    "experiment": TEXT,
                    "method": TEXT,
                    "file": TEXT,
                    **BODY_KEYS,
                    "standard_deviation": BODY,
                    "accepted": {"type": ["boolean", "null"]},
                }
            )
        ),
        "pairs": list_of(
            entry(
                {
                    "first": TEXT,
                    "second": TEXT,
                    "basis": TEXT,
                    "difference": TEN,
                    "standard_deviation": TEN,
                    "sigmas": TEN,
                    "covariance": COVARIANCE,
                    "agreement": _TEST,
                }
            )
        ),
        "whole": or_null(_TEST),
        "notes": TEXTS,
    }
)

_STREAM = entry(
    {
        "run": TEXT,
        "instrument": TEXT,
        "kind": TEXT,
        "samples": COUNT,
        "rate": NUMBER,
        "duration": NUMBER,
        "faults": list_of({}),
        "quantities": named(ANYTHING),
    }
)
INSPECTION = entry(
    {
        "experiment": TEXT,
        "streams": list_of(_STREAM),
        "delays": list_of(entry({"run": TEXT, "instruments": TEXTS, "delay": NUMBER})),
        "agreements": list_of(entry({"run": TEXT, "between": TEXT, "agrees": FLAG})),
        "mistakes": list_of(ANYTHING),
        "contacts": list_of(ANYTHING),
        "excitation": or_null(ANYTHING),
        "modes": list_of(ANYTHING),
        "remarks": list_of({}),
    },
    {"slack": list_of(entry({"run": TEXT, "cables": named(NUMBER), "left_out": NUMBER}))},
)

WATCH = entry(
    {
        "t": KNOWN,
        "load": TEXT,
        **BODY_KEYS,
        "standard_deviation": BODY,
        "accepted": {"type": ["boolean", "null"]},
        "reasons": TEXTS,
        "events": list_of(ANYTHING),
        "unmodelled": or_null(list_of(NUMBER, 6)),
    },
    {"seconds_until": named(NUMBER)},
)

_SIX = entry(dict.fromkeys(("xx", "yy", "zz", "yz", "xz", "xy"), NUMBER))
_PLATFORM = entry({"mass": NUMBER, "center_of_gravity": THREE, "inertia": _SIX})
BODY_FILE = entry(
    {
        "platform": _PLATFORM,
        "standard_deviation": _PLATFORM,
        "covariance": COVARIANCE,
        "linear": entry({"parameters": TEXTS, "values": list_of(NUMBER)}),
        "verdict": entry({"accepted": {"type": ["boolean", "null"]}, "reasons": TEXTS}),
        "method": TEXT,
        "experiment": TEXT,
        "source": entry({"file": TEXT, "sha256": TEXT, "steelyard": TEXT}),
    }
)

FREQUENCIES = entry(
    {
        "robot": TEXT,
        "elastic": FLAG,
        "pose": list_of(KNOWN, 6),
        "lengths": list_of(NUMBER),
        "modes": list_of(
            entry({"frequency": NUMBER, "standard_deviation": NUMBER, "shape": list_of(NUMBER, 6)})
        ),
        "tension": list_of(NUMBER),
    }
)

TRUTH = entry(
    {"mass": KNOWN, "center_of_gravity": list_of(KNOWN, 3), "inertia": list_of(THREE, 3)},
    {"calibration": named(ANYTHING), "loads": named(KNOWN_BODY)},
)

STATUS = one_of("done", "refused", "lost")
