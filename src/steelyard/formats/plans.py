"""Schemas of what was planned (motions, poses, references) and of many experiments."""

from __future__ import annotations

from steelyard.estimates.per_mass import PER_MASS_PARAMETERS
from steelyard.formats.parts import (
    ANYTHING,
    BODY,
    COUNT,
    FLAG,
    FOUND_ERRORS,
    KNOWN,
    KNOWN_BODY,
    KNOWN_THREE,
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

_PER_MASS = entry(dict.fromkeys(PER_MASS_PARAMETERS, NUMBER))
SWINGS = entry(
    {
        "robot": TEXT,
        "experiment": TEXT,
        "cables": list_of(COUNT),
        "duration": KNOWN,
        "swings": list_of(
            entry(
                {
                    "position": KNOWN_THREE,
                    "rpy_deg": KNOWN_THREE,
                    "lengths": list_of(KNOWN),
                    "frequencies": list_of(KNOWN),
                    "mode": or_null(COUNT),
                    "push": TEXT,
                    "amplitude": KNOWN,
                    "least_tension": KNOWN,
                    "standard_deviation": _PER_MASS,
                }
            )
        ),
        "standard_deviation": or_null(_PER_MASS),
        "sets": list_of(
            entry({"cables": list_of(COUNT), "swings": COUNT, "standard_deviation": _PER_MASS})
        ),
        "candidates": COUNT,
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
