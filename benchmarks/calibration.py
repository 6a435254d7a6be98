"""A robot's own calibration from poses at rest: what is found, against the truth and its 1-sigma.

`python benchmarks/calibration.py [DRAWS]`: robots of 3, 4, 8 and 12 cables,
forty poses, lengths and tracker of .5 mm, anchors off by 30 cm and attachments by 3 cm.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from halls import errors, recorded

from steelyard.calibration.calibrate import calibrate

FIRST_SEED = 800_000
"""Apart from the seeds of every test and of the other benchmarks."""


def main(count: int) -> None:
    print(
        "cables  draws  accepted  chi2/k  95 %   anchor rms  1-sigma  attachment rms  1-sigma   CPU"
    )
    for m in (3, 4, 8, 12):
        chi, inside, accepted, spent = [], [], 0, 0.0
        off, sigma = [], []
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            experiment, true = recorded(seed, m=m)
            begun = time.process_time()
            found = calibrate(experiment)
            spent += time.process_time() - begun
            error = errors(found, true)
            chi.append(float(error @ np.linalg.solve(found.covariance, error)) / len(error))
            deviation = np.sqrt(np.diag(found.covariance))
            inside.append(np.mean(np.abs(error) < 1.96 * deviation))
            accepted += not found.reasons
            off.append(error)
            sigma.append(deviation)
        rms, stated = (
            [
                1000 * np.sqrt(np.mean(np.square(part)))
                for part in np.split(np.array(each), 2, axis=1)
            ]
            for each in (off, sigma)
        )
        print(
            f"{m:6d} {count:6d} {accepted:9d} {np.mean(chi):7.2f} {np.mean(inside):5.1%}"
            f" {rms[0]:8.2f} mm {stated[0]:5.2f} mm {rms[1]:12.2f} mm {stated[1]:5.2f} mm"
            f" {spent / count:5.2f} s",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
