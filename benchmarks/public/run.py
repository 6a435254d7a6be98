"""Runs methods on the recordings of the public benchmark and prints the table: `python
benchmarks/public/run.py [METHOD.py ...]`.

Without a file all methods of `peers/` run. Each runs on each recording in a process of its own;
what is there with the same files is not done again.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from score import FORMAT, TEN, markdown, read_results, score

HERE = Path(__file__).resolve().parent
ORDER = (
    "steelyard_two_step", "steelyard_least_squares", "steelyard_consistent",
    "steelyard_maximum_likelihood", "steelyard_on_platform", "ordinary_least_squares",
    "total_least_squares", "semidefinite", "extended_kalman_filter", "mujoco_sysid", "gtsam_smoother",
)  # fmt: skip
"""Methods of `peers/` as the table has them."""
PATIENCE = 600.0
"""After which a method has failed [s]."""
PACKAGES = ("steelyard", "numpy", "scipy", "mujoco", "pin", "cvxpy", "clarabel", "gtsam")


def load(path: Path) -> ModuleType:
    """A method: a file with NAME, DATA and `estimate(folder)`."""
    if str(HERE) not in sys.path:
        sys.path.insert(0, str(HERE))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise SystemExit(f"{path}: expected a Python file, found none; correct the path")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    lacking = [key for key in ("NAME", "DATA", "estimate") if not hasattr(module, key)]
    if lacking:
        raise SystemExit(
            f"{path}: expected {', '.join(lacking)}, found none; see example_method.py"
        )
    return module


def plain(values: Any) -> Any:
    """Numbers as JSON has them, null for what is not finite."""
    if values is None:
        return None
    array = np.asarray(values, dtype=float)
    nested = np.where(np.isfinite(array), array, 0.0).tolist()
    for index in np.argwhere(~np.isfinite(array)):
        inner = nested
        for each in index[:-1]:
            inner = inner[each]
        inner[index[-1]] = None
    return nested


def result_of(path: Path, data: Path, recording: str) -> dict[str, Any]:
    """Run a method on a recording; whatever it raises is its failure."""
    method = load(path)
    head = {
        "format": FORMAT,
        "method": method.NAME,
        "recording": recording,
        "data": method.DATA,
        "sha256": digest(path),
    }
    try:
        found = method.estimate(data / recording)
        if not isinstance(found, dict):
            found = dict(zip(("value", "covariance"), found, strict=False))
        return {
            **head,
            "value": plain(found["value"]),
            "covariance": plain(found.get("covariance")),
            "accepted": found.get("accepted"),
            "failure": None,
        }
    except Exception as error:
        words = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
        return {**head, **nothing(words)}


def nothing(failure: str) -> dict[str, Any]:
    """The part of a result where there is none."""
    return {"value": [None] * TEN, "covariance": None, "accepted": None, "failure": failure}


def digest(path: Path) -> str:
    """Of a method's file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def run_one(path: Path, data: Path, recording: str, out: Path) -> str:
    """Run a method on a recording in a process of its own and write its result; a line about it."""
    if out.exists() and json.loads(out.read_text("utf-8")).get("sha256") == digest(path):
        return f"{path.stem:32} {recording:32} is there"
    out.parent.mkdir(parents=True, exist_ok=True)
    # Beside the result, which appears when it is whole.
    part = out.with_suffix(".part")
    command = [sys.executable, __file__, "--one", str(path), str(data), recording, str(part)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    child = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    began = time.monotonic()
    while True:
        found, status, usage = os.wait4(child.pid, os.WNOHANG)
        if found:
            child.returncode = os.waitstatus_to_exitcode(status)
            break
        if time.monotonic() - began > PATIENCE:
            child.kill()
            _, status, usage = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            break
        time.sleep(0.05)
    if child.returncode:
        method = load(path)
        head = {"format": FORMAT, "method": method.NAME, "recording": recording}
        ended = f"its process ended with {child.returncode} after {time.monotonic() - began:.0f} s"
        result = {**head, "data": method.DATA, "sha256": digest(path), **nothing(ended)}
    else:
        result = json.loads(part.read_text("utf-8"))
    result["seconds"] = round(usage.ru_utime + usage.ru_stime, 3)
    result["mebibytes"] = round(usage.ru_maxrss / 1024, 1)
    part.write_text(json.dumps(result) + "\n", encoding="utf-8")
    part.replace(out)
    return f"{path.stem:32} {recording:32} {result['seconds']:6.1f} s  {result['failure'] or ''}"


def recordings(data: Path) -> list[str]:
    """Names of all that have a truth, the same condition of all robots together."""
    truths = data / "truth"
    names = [each.relative_to(truths).with_suffix("").as_posix() for each in truths.rglob("*.json")]
    return sorted(names, key=lambda name: (name.partition("/")[2], name))


def versions() -> Iterator[str]:
    """What the table was made with."""
    yield f"Python {platform.python_version()}"
    for package in PACKAGES:
        try:
            yield f"{package} {version(package)}"
        except PackageNotFoundError:
            continue


def ordered(scored: dict[str, Any], methods: Sequence[Path]) -> dict[str, Any]:
    """The table's rows in the order of the methods."""
    modules = [load(path) for path in methods]
    names = [f"{each.NAME} [{each.DATA}]" for each in modules]
    return {name: scored[name] for name in dict.fromkeys([*names, *scored]) if name in scored}


def main() -> None:
    """Run what is missing, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "methods", nargs="*", type=Path, help="files of methods; default: all peers"
    )
    parser.add_argument("--data", type=Path, default=HERE / "data")
    parser.add_argument("--results", type=Path, default=HERE / "data" / "results")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--only", default="", help="a part of the names of recordings, such as plain"
    )
    given = parser.parse_args()
    known = [name for name in recordings(given.data) if given.only in name]
    if not known:
        raise SystemExit(
            f"{given.data}: expected recordings, found none; run `make benchmark-data` first"
        )
    peers = [HERE / "peers" / f"{name}.py" for name in ORDER]
    methods = [path.resolve() for path in given.methods] or peers
    for path in methods:
        if not path.is_file():
            raise SystemExit(
                f"{path}: expected a method's Python file, found none; correct the path"
            )
        load(path)
    # Recordings outside, so that a table of half of the work compares like with like.
    jobs = [
        (path, given.data, name, given.results / path.stem / f"{name}.json")
        for name in known
        for path in methods
    ]
    with ThreadPoolExecutor(given.processes) as pool:
        for line in pool.map(lambda job: run_one(*job), jobs):
            print(line, flush=True)
    everything = ordered(score(read_results(given.results), given.data / "truth"), peers)
    table = {
        "format": FORMAT,
        "date": time.strftime("%Y-%m-%d"),
        "versions": list(versions()),
        "recordings": known,
        "scores": everything,
    }
    text = f"{len(known)} recordings; {table['date']}; {', '.join(table['versions'])}\n"
    for group in dict.fromkeys(group for each in everything.values() for group in each):
        text += f"\n### {group}\n\n{markdown(everything, group)}"
    (given.data / "table.md").write_text(text, encoding="utf-8")
    (given.data / "table.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        method_file, data_folder, wanted, target = sys.argv[2:]
        done = result_of(Path(method_file), Path(data_folder), wanted)
        Path(target).write_text(json.dumps(done) + "\n", encoding="utf-8")
    else:
        main()
