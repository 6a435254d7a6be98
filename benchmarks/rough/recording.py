"""One recording as files: `recorded(robot, kind, number, folder)`."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import kinds, robots
from .motion import course
from .sensors import READS, Scene, Stream, cells
from .shared import Array, public


def seed_of(robot: str, kind: str, number: int) -> int:
    """Of a recording; the same whatever else is drawn."""
    digest = hashlib.sha256(f"rough/{robot}/{kind}-{number:02d}".encode()).digest()
    return int.from_bytes(digest[:4], "big")


def recorded(
    robot_name: str,
    kind_name: str,
    number: int,
    folder: Path,
    duration: float,
    motion: str = "multisine",
) -> tuple[Path, Array]:
    """Write a recording; its experiment file and the true body, mass first, shape (10,)."""
    draw, path, *noises = np.random.default_rng(seed_of(robot_name, kind_name, number)).spawn(9)
    robot = robots.drawn(robots.ROBOTS[robot_name], draw)
    kind = replace(kinds.drawn(kinds.KINDS[kind_name], draw), motion=motion)
    sigma, plain = robot.geometry, robot.plain
    anchors = plain.anchors + sigma * draw.standard_normal(plain.anchors.shape)
    attachments = plain.attachments + sigma * draw.standard_normal(plain.attachments.shape)
    moved = course(robot, kind, anchors, attachments, duration, path)
    scene = Scene(robot, kind, moved, anchors, attachments, duration, float(draw.uniform(0, 5)))
    streams = {"cables": cells(scene, noises[0])}
    for (name, read), noise in zip(READS.items(), noises[1:], strict=False):
        if name in kind.instruments:
            streams[name] = read(scene, noise)
    _write(scene, streams, folder, f"{robot_name}-{kind_name}-{number:02d}")
    truth = {"body": moved.body.tolist(), "slack": moved.slack}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return folder / "experiment.yaml", moved.body


def _write(scene: Scene, streams: dict[str, Stream], folder: Path, name: str) -> None:
    """The experiment, the robot as stated and the tables."""
    (folder / "run").mkdir(parents=True, exist_ok=True)
    robot, plain = scene.robot, scene.robot.plain
    run: dict[str, Any] = {"name": "run"}
    for key, stream in streams.items():
        lines = [",".join([f"{r[0]:.7f}", *(f"{v:.8g}" for v in r[1:])]) for r in stream.values]
        text = "\n".join([stream.header, *lines, ""])
        (folder / "run" / f"{key}.csv").write_text(text, encoding="utf-8")
        run[key] = f"run/{key}.csv"
    run["sync"] = {key: stream.sync for key, stream in streams.items()}
    experiment: dict[str, Any] = {
        "format": "steelyard/1",
        "name": name,
        "robot": "robot.yaml",
        "instruments": {key: dict(stream.stated) for key, stream in streams.items()},
        "runs": [run],
    }
    if robot.geometry != 0.002:
        experiment["uncertainty"] = {"anchor": robot.geometry, "attachment": robot.geometry}
    if scene.kind.pushed:
        experiment["known"] = {"mass": float(scene.course.body[0])}
    cables = [
        {"anchor": a, "attachment": b}
        for a, b in zip(plain.anchors.tolist(), plain.attachments.tolist(), strict=True)
    ]
    stated = {
        "name": plain.name,
        "gravity": public.GRAVITY,
        "cables": cables,
        "cable": {"diameter": 0.004, "axial_stiffness": plain.axial_stiffness},
    }
    for file, content in (("experiment.yaml", experiment), ("robot.yaml", stated)):
        # JSON is YAML.
        (folder / file).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
