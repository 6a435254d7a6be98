"""What the public benchmark lends: its robots, its kinematics, its integration's constants."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

Array = np.ndarray
_HOME = str(Path(__file__).parents[1] / "public")


def _lent() -> SimpleNamespace:
    """Modules of a folder that is no package, under their own names for the moment of import."""
    before = {name: sys.modules.pop(name, None) for name in ("robots", "simulator", "generate")}
    sys.path.insert(0, _HOME)
    try:
        robots, simulator, generate = (
            importlib.import_module(name) for name in ("robots", "simulator", "generate")
        )
    finally:
        sys.path.remove(_HOME)
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module
    return SimpleNamespace(
        GRAVITY=robots.GRAVITY,
        PublicRobot=robots.PublicRobot,
        COGIRO=robots.COGIRO,
        FOUR_CABLES=robots.FOUR_CABLES,
        EIGHT_TIGHT=robots.EIGHT_TIGHT,
        DESK=robots.DESK,
        DAMPING_RATIO=simulator.DAMPING_RATIO,
        SETTLING=simulator.SETTLING,
        SEEN=simulator.SEEN,
        Cables=simulator.Cables,
        Moved=simulator.Moved,
        Motion=simulator.Motion,
        commanded=simulator.commanded,
        fed_lengths=simulator.fed_lengths,
        structure_of=simulator.structure_of,
        rolled=generate.rolled,
        quaternions=generate._quaternions,
        rotation_of=generate._exp,
    )


public = _lent()
