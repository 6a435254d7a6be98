"""A comparison of references as plain values: ``reference.json``."""

from __future__ import annotations

from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import named
from steelyard.excitation.references.reference_design import ReferenceDesign, ReferencePrediction

FORMAT = "steelyard-reference/1"
RESULT = "reference.json"


def reference_dict(design: ReferenceDesign) -> dict[str, Any]:
    """In the shape of the contract; null where nothing is told."""
    return {
        "format": FORMAT,
        "experiment": design.experiment.name,
        "robot": design.experiment.robot.name,
        "recorded": design.recorded,
        "without": {"standard_deviation": named(design.without.standard_deviation)},
        "criterion": design.criterion,
        "target": None if design.target is None else named(design.target.each),
        "not_at_rest": design.not_at_rest,
        "candidates": [_candidate(design, each) for each in design.predictions],
    }


def _candidate(design: ReferenceDesign, prediction: ReferencePrediction) -> dict[str, Any]:
    """One recording more, with what it brings."""
    addition = prediction.addition
    return {
        "what": str(addition),
        "kind": addition.kind.replace(" ", "-"),
        "mass": addition.mass,
        "position": None if addition.position is None else addition.position.tolist(),
        "carried": "in motion" if addition.poses is None else "at rest",
        "poses": None if addition.poses is None else [_pose(pose) for pose in addition.poses],
        "standard_deviation": named(prediction.standard_deviation),
        "ratio": named(design.ratios(prediction)),
        "score": design.score(prediction),
    }


def _pose(pose: Array) -> dict[str, Any]:
    return {"position": pose[:3].tolist(), "rpy_deg": np.degrees(pose[3:]).tolist()}
