"""Whether stated 1-sigma are true, and what the verdict rejects: `steelyard study` of CoGiRo on
straight cables. A folder that is named is gone on with.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from recorder import FIRST_SEED, METHODS

from steelyard.campaigns.study.document import study_document
from steelyard.campaigns.study.run import ALL, study
from steelyard.experiment.write import write_yaml
from steelyard.report.forms.terminal import show
from steelyard.robot.file import read_robot, robot_file


def studied(folder: Path, draws: int, methods: tuple[str, ...] = METHODS, **keys: object) -> None:
    """Print what draws of 20 s on six axes with the sensors of the paper say."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = folder / "robot.yaml"
    write_yaml(robot_file(read_robot("cogiro").with_straight_cables()), robot)
    jobs = os.cpu_count() or 1
    found = study(
        robot, folder / "study", draws, methods, duration=20.0, seed=FIRST_SEED, jobs=jobs, **keys
    )
    show(study_document(found))


def coverage(folder: Path, draws: int = 200) -> None:
    """All methods."""
    studied(folder, draws)


def verdicts(folder: Path, draws: int = 100) -> None:
    """Every mistake in every draw."""
    studied(folder, draws, ("least-squares",), mistakes=ALL)


if __name__ == "__main__":
    chosen = {"coverage": coverage, "verdicts": verdicts}[sys.argv[1]]
    chosen(Path(sys.argv[2]), *map(int, sys.argv[3:4]))
