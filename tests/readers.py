"""Every reader of the package with small sound files: what a changed file is given to."""

import gzip
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import log_files
import polars as pl
from places import DATA, ROOT

import steelyard
from steelyard.campaigns.journal import joined
from steelyard.cli.truth import known_truth
from steelyard.drafts.draft import draft
from steelyard.errors import SteelyardError
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.experiment.read import read_experiment
from steelyard.live.message import arrivals_of
from steelyard.logs.formats import open_log, topics
from steelyard.provenance.verify import verify
from steelyard.report.evidence.report_file import read_summary
from steelyard.robot.file import read_robot
from steelyard.simulation.sensors import read_sensors
from steelyard.simulation.trajectories import trajectories

KEPT = DATA / "formats"
SOUND = DATA / "corpus" / "sound"
CRASHES = DATA / "corpus" / "found"
"""Files that a reader once failed on, one folder a target: they are read with every test."""


@dataclass(frozen=True)
class Target:
    """A reader and where a changed file must lie for it."""

    sound: Callable[[Path], Sequence[Path]]
    """Gives sound files, made in a folder where they are not kept."""
    read: Callable[[Path], object]
    """Reads a changed file."""
    beside: Path | None = None
    """Folder with what lies beside it."""


def _kept(*names):
    return lambda folder: [KEPT / name for name in names]


def _log(path):
    """All columns of all topics; also what `init` makes of them."""
    for topic in topics(path) or [None]:
        with open_log(path, topic) as log:
            names = [name for name in log.names if log.names.count(name) == 1]
            for name in names[:40]:
                try:
                    log.read([name])
                except SteelyardError:
                    continue
    return


def _draft(path):
    return draft([path], read_robot("cogiro"))


def _logs(*names):
    return lambda folder: [log_files.small(_new(folder))[name][0] for name in names]


def _new(folder):
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        path.unlink()
    return folder


def _text(folder):
    found = []
    for name, table in log_files.streams(20).items():
        for ending, options in {
            ".csv": {},
            ".tsv": {"separator": "\t"},
            ".dat": {"separator": ";", "comma": True},
            ".csv.gz": {},
        }.items():
            path = folder / f"{name}{ending}"
            log_files.write_csv(path, table, **options)
            found.append(path)
    return found


def _parquet(folder):
    table = log_files.streams(20)["imu"]
    flat, nested = folder / "flat.parquet", folder / "nested.parquet"
    log_files.write_parquet(flat, table)
    frame = pl.DataFrame(table)
    frame.select(
        "t", pl.struct("wx", "wy").alias("w"), pl.col("ax").cast(pl.Float32)
    ).write_parquet(nested, compression="snappy")
    return [flat, nested, KEPT / "tidy" / "cables.parquet"]


def _yaml(name, *folders):
    found = [path for each in folders for path in sorted(each.rglob(f"{name}*.yaml"))]
    return lambda folder: found


def _imported(path):
    return steelyard.import_robot([path])


def _caspr(path):
    both = [DATA / "caspr/CoGiRo" / f"CoGiRo_{name}.xml" for name in ("bodies", "cables")]
    kind = "bodies" if "bodies" in path.name else "cables"
    return steelyard.import_robot([path if kind in each.name else each for each in both])


def _messages(folder):
    one = {"instrument": "imu", "t": 1.0, "wx": 0.1, "wy": 0, "wz": 0, "ax": 0, "ay": 0, "az": 9.81}
    many = {"instrument": "tracker", "t": [1.0, 1.1], "x": [0, 1], "y": [0, 1], "z": [0, 1]}
    forces = {"instrument": "cables", "t": 1.0, **{f"f{i + 1}": 500.0 for i in range(8)}}
    for i, each in enumerate((one, many, forces)):
        (folder / f"{i}.msg").write_text(json.dumps(each))
    (folder / "3.msg").write_text(json.dumps([one, many, forces]))
    return sorted(folder.glob("*.msg"))


def _arrivals(path):
    experiment = read_experiment(KEPT / "experiment" / "experiment.yaml")
    return arrivals_of(path.read_bytes(), experiment.instruments, experiment.robot.m)


def _commanded(path):
    return trajectories(read_robot("cogiro"), str(path), None, check=False)


TARGETS = {
    "text": Target(_text, _log),
    "init": Target(_text, _draft),
    "parquet": Target(_parquet, _log),
    "npz": Target(_logs("imu.npz"), _log),
    "mcap": Target(_logs("json.mcap", "ros2.mcap"), _log),
    "bag": Target(_logs("ros1.bag"), _log),
    "db3": Target(_logs("old.db3"), _log),
    "hdf5": Target(_logs("a.h5"), _log),
    "mat": Target(_logs("v5.mat", "v73.mat"), _log),
    "tdms": Target(_logs("a.tdms"), _log),
    "experiment": Target(
        _yaml("experiment", KEPT / "experiment", ROOT / "examples"),
        read_experiment,
        KEPT / "experiment",
    ),
    "robot": Target(
        _yaml("", KEPT / "calibrated", ROOT / "src/steelyard/robot/library"),
        lambda path: read_robot(path.name, path.parent),
        KEPT / "calibrated",
    ),
    "covariance": Target(
        _kept("calibrated/robot.covariance.csv"),
        lambda path: read_robot("robot.yaml", path.parent),
        KEPT / "calibrated",
    ),
    "sensors": Target(
        _yaml("sensors", ROOT / "examples"),
        lambda path: read_sensors(str(path), read_robot("cogiro")),
    ),
    "command": Target(_kept("command.csv", "poses.csv"), _commanded),
    "estimate": Target(_kept("identified/estimate.json"), read_estimate_file),
    "report": Target(_kept("identified/report.json"), read_summary),
    "provenance": Target(
        _kept("identified/provenance.json"),
        lambda path: verify(path.parent),
        KEPT / "identified",
    ),
    "truth": Target(_kept("truth.json"), lambda path: known_truth(path.parent)),
    "campaign": Target(
        _kept("campaign/campaign.parquet", "campaign/campaign.rows.jsonl"),
        lambda path: joined(path.parent),
        KEPT / "campaign",
    ),
    "message": Target(_messages, _arrivals),
    "caspr": Target(lambda folder: sorted((DATA / "caspr" / "CoGiRo").glob("*.xml")), _caspr),
    "import": Target(lambda folder: sorted(SOUND.iterdir()), _imported),
}
"""Name -> reader."""


def sound_files(name, folder):
    """Path -> bytes of the sound files of a target."""
    folder = folder / f"sound-{name}"
    folder.mkdir(parents=True, exist_ok=True)
    return {path: path.read_bytes() for path in TARGETS[name].sound(folder)}


def repacked(content):
    """Text that was changed, packed again, so that readers unpack it."""
    return gzip.compress(content, mtime=0)
