"""Schemas of what was planned (motions, poses, references) and of many experiments."""

from __future__ import annotations

from steelyard.formats.parts import (
    ANYTHING,
    BODY,
    COUNT,
    FLAG,
    FOUND_ERRORS,
    KNOWN,
    KNOWN_BODY,
    NUMBER,
    POINTS,
    POSE,
    TEN,
    TEXT,
    TEXTS,
    THREE,
    entry,
    list_of,
    named,
    one_of,
    or_null,
)

_ENDS = {"file": TEXT, "duration": KNOWN, "start": POSE, "end": POSE}
DESIGN = entry(
    {
        "robot": TEXT,
        "experiment": TEXT,
        "duration": KNOWN,
        "standard_deviation": BODY,
        "limits": ANYTHING,
        "feasible": FLAG,
        "violations": TEXTS,
        "target": or_null(BODY),
        "worst": or_null(ANYTHING),
        "unidentifiable": TEXTS,
        "all_runs": ANYTHING,
        "commands": list_of(entry(_ENDS, {"told": {}})),
    },
    {
        "margin": or_null(ANYTHING),
        "tension_level": NUMBER,
        "natural_frequencies": or_null(list_of(NUMBER)),
        "highest_frequency": NUMBER,
        "search": or_null(ANYTHING),
    },
)

POSES = entry(
    {
        "robot": TEXT,
        "experiment": TEXT,
        "poses": list_of(POSE),
        "standard_deviation": entry({"anchors": POINTS, "attachments": POINTS}),
        "calibration": FOUND_ERRORS,
        "gauge": TEXTS,
        "unobservable": TEXTS,
        "over_regular_grid": or_null(ANYTHING),
        "candidates": COUNT,
        "tension_level": NUMBER,
        "seed": COUNT,
    }
)

REFERENCE = entry(
    {
        "experiment": TEXT,
        "robot": TEXT,
        "recorded": FLAG,
        "without": entry({"standard_deviation": BODY}),
        "criterion": TEXT,
        "target": or_null(ANYTHING),
        "not_at_rest": or_null(TEXT),
        "candidates": list_of(
            entry(
                {
                    "what": TEXT,
                    "kind": one_of("added", "in-place", "poses"),
                    "mass": NUMBER,
                    "position": or_null(THREE),
                    "carried": or_null(TEXT),
                    "poses": or_null(list_of(POSE)),
                    "standard_deviation": BODY,
                }
            )
        ),
    }
)

_METHOD = entry(
    {
        "count": COUNT,
        "accepted": COUNT,
        "rejected": COUNT,
        "joint_chi_square": NUMBER,
        "joint_count": COUNT,
        "parameters": {**TEN, "properties": dict.fromkeys(TEN["properties"], ANYTHING)},
    }
)
STUDY = entry(
    {
        "of": TEXT,
        "kind": one_of("simulation", "bootstrap"),
        "draws": COUNT,
        "truth": or_null(KNOWN_BODY),
        "methods": named(_METHOD),
        "problems": TEXTS,
    }
)

CAMPAIGN = entry(
    {
        "folder": TEXT,
        "experiments": COUNT,
        "unchanged": COUNT,
        "counts": named(COUNT),
        "problems": TEXTS,
    }
)
