"""Worker, scheduler and client of a campaign killed at random: what is lost, what is there twice, and
whether the table is the undisturbed one in its numbers: `killed.py [TIMES [ENGINE-TARGET ...]]`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from killed_campaigns import TARGETS, campaign_of, killed, recordings_in

COUNT = 10


def main(times: int, only: list[str]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as temporary:
        top = Path(temporary)
        data = recordings_in(top / "data", COUNT)
        campaign_of(data, top / "whole", "--jobs", "1").communicate()
        print(
            f"{COUNT} experiments, killed with SIGKILL at random\n\n| engine | killed | rows on disk"
            " then | ended with | done before, the second time | lost | twice | the undisturbed"
            " table |\n|---|---|---:|---:|---:|---:|---:|---|"
        )
        chosen = [(e, target) for e, targets in TARGETS.items() for target in targets]
        for engine, target in chosen:
            if only and f"{engine}-{target}" not in only:
                continue
            for i in range(times):
                found = killed(engine, target, data, top / f"{engine}-{target}-{i}", COUNT, i)
                columns = (found.rows, found.status, found.again, found.lost, found.twice)
                same = "yes" if found.same else "NO"
                print(
                    f"| {engine} | {target} | {' | '.join(map(str, columns))} | {same} |",
                    flush=True,
                )
                if found.said:
                    print(f"    {target}: {found.said}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5, sys.argv[2:])
