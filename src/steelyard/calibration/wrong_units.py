"""Points of a robot file that were typed in millimetres."""

from __future__ import annotations

import numpy as np

from steelyard.experiment.model import Experiment

_THOUSAND = (300.0, 3000.0)
"""Ratio of two sizes that should be alike, where one of them is in millimetres."""


def in_millimetres(experiment: Experiment) -> str:
    """What seems to be in millimetres, in one sentence; empty: nothing.

    Lengths have an unknown zero, so that this is a guess, for a calibration that has failed.

    Args:
        experiment: With robot file and recordings.
    """
    robot = experiment.robot
    if not robot.m:
        return ""
    hall, platform = (
        float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean())
        for points in (robot.anchors, robot.attachments)
    )
    seen = [
        np.nanmedian(np.abs(stream.values["length"]))
        for run in experiment.runs
        for name, stream in run.streams.items()
        if experiment.instruments[name].is_cable_motion and "length" in stream.values
    ]
    if seen and (read := float(np.median(seen))) > 0:
        if _THOUSAND[0] < hall / read < _THOUSAND[1]:
            return (
                f"anchors lie {hall:.4g} m about their middle where cables read {read:.4g} m: the"
                " robot file seems to be in millimetres; write metres"
            )
        if _THOUSAND[0] < read / hall < _THOUSAND[1]:
            return (
                f"cables read {read:.4g} m where anchors lie {hall:.4g} m about their middle:"
                f" lengths seem to be in millimetres; state their unit ('units: {{l1: mm, …}}')"
            )
    if platform > _THOUSAND[0] / 10 * hall:
        return (
            f"attachments lie {platform:.4g} m about their middle, anchors {hall:.4g} m:"
            " attachments seem to be in millimetres; write metres"
        )
    return ""
