"""Worker, scheduler and client of a campaign killed at random: what is lost, what is there twice, and
whether the table is the undisturbed one in its numbers: `killed.py [TIMES [ENGINE-TARGET ...]]`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from killed_campaigns import TARGETS, campaign_of, killed, recordings_in

COUNT = 20


def main(times: int, only: list[str]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as temporary:
        top = Path(temporary)
        data = recordings_in(top / "data", COUNT)
        campaign_of(data, top / "whole", "--jobs", "1").communicate()
        print(
            f"{COUNT} experiments, killed with SIGKILL at random\n\n| engine | killed | rows on disk"
            " then | ended with | done before, the second time | lost | twice | the undisturbed"
            " table |\n|---|---|---|---|---|---:|---:|---:|"
        )
        for engine, targets in TARGETS.items():
            for target in (each for each in targets if not only or f"{engine}-{each}" in only):
                found = [
                    killed(engine, target, data, top / f"{engine}-{target}-{i}", COUNT, i)
                    for i in range(times)
                ]
                columns = (
                    ", ".join(str(each.rows) for each in found),
                    ", ".join(str(each.status) for each in found),
                    ", ".join(str(each.again) for each in found),
                    sum(each.lost for each in found),
                    sum(each.twice for each in found),
                    f"{sum(each.same for each in found)} of {times}",
                )
                print(f"| {engine} | {target} | {' | '.join(map(str, columns))} |", flush=True)
                for said in sorted({each.said for each in found if each.said}):
                    print(f"    {target}: {said}", file=sys.stderr)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5, sys.argv[2:])
