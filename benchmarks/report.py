"""The report of an experiment of one hour: how long it takes beside the estimate, and how large it
is.

Run as ``python benchmarks/report.py FOLDER [METHOD]``; the estimate in the same process is the
reference.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

from hour import DURATION, write_long

from steelyard.experiment.read import read_experiment
from steelyard.identification.chosen_methods import AVAILABLE
from steelyard.identification.identify import identify
from steelyard.report.evidence.made import made_of
from steelyard.report.evidence.report_file import read_summary
from steelyard.report.evidence.summary import summarise
from steelyard.report.write import draw_report, write_report

MIB = 1 << 20


def main(folder: Path, method: str = "least-squares") -> None:
    recording = folder / "hour"
    path = recording / "experiment.yaml"
    if not path.exists():
        write_long(recording, DURATION)
    experiment = timed("reading", lambda: read_experiment(path))
    identification = timed(
        f"estimate, {method}: the reference", lambda: identify(experiment, [AVAILABLE[method]()])
    )
    start = time.perf_counter()
    made = timed("  hashes of the files", lambda: made_of(experiment, {"method": method}))
    summary = timed("  what is shown, thinned", lambda: summarise(identification, made=made))
    timed("  drawn and written", lambda: write_report(summary, folder))
    print(f"report: {time.perf_counter() - start:.1f} s")
    timed("drawn again from report.json", lambda: draw_report(read_summary(folder), folder))
    for name in ("report.html", "report.md", "report.json"):
        print(f"{name:12} {(folder / name).stat().st_size / 1e6:6.2f} MB")


def timed(what, work):
    start = time.perf_counter()
    found = work()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MIB
    print(f"{what:36} {time.perf_counter() - start:7.2f} s   peak {peak:6.0f} MiB", flush=True)
    return found


if __name__ == "__main__":
    if len(sys.argv) > 1:
        Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
        main(Path(sys.argv[1]), *sys.argv[2:3])
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
