"""What a stream shows by itself: a unit of time that was forgotten, a dead channel, noise that is
none of the stated one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from steelyard.experiment.faults.of_streams import channels
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.inspection.settings import REMARKS, RemarkSettings
from steelyard.inspection.streams import StreamReport
from steelyard.units import FACTORS

_TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}


def of_times(experiment: Experiment, run: Run, settings: RemarkSettings = REMARKS) -> Iterator[str]:
    """Streams whose recording is a thousand times longer or shorter than that of the others."""
    if run.static or len(run.streams) < 2:
        return
    lengths = {name: float(s.time[-1] - s.time[0]) for name, s in run.streams.items() if len(s) > 1}
    for name, length in lengths.items():
        others = [other for n, other in lengths.items() if n != name and other > 0]
        if not others or length <= 0:
            continue
        ratio = length / float(np.median(others))
        for unit, factor in _TIME_UNITS.items():
            if abs(np.log(ratio * factor)) < settings.like:
                yield (
                    f"run '{run.name}': the time of {name} seems to be in {unit}, not in s: state"
                    f" units: {{t: {unit}}}"
                )
            elif abs(np.log(ratio / factor)) < settings.like:
                yield (
                    f"run '{run.name}': the time of {name} seems to be in s, not in {unit}: correct"
                    " 'units' of its column t"
                )


def constant_channels(experiment: Experiment) -> Iterator[str]:
    """Channels that never change while others of their instrument do; those beside others that read
    noise have been left out already, and are named among the faults.
    """
    for run in experiment.runs:
        for name, stream in run.streams.items():
            if experiment.instruments[name].commanded or experiment.instruments[name].may_rest:
                continue
            spread: dict[str, dict[str, float]] = {}
            for label, quantity, i, values in channels(stream):
                if i is not None:
                    known = values[~np.isnan(values)]
                    if len(known):
                        spread.setdefault(quantity, {})[label] = float(np.ptp(known))
            for of_quantity in spread.values():
                constant = [label for label, extent in of_quantity.items() if extent == 0]
                if len(constant) == 1 and len(of_quantity) > 1:
                    yield (
                        f"run '{run.name}': {constant[0]} of {name} never changes: a dead channel;"
                        " look at its sensor and cable"
                    )


def of_noise(
    experiment: Experiment, reports: Sequence[StreamReport], settings: RemarkSettings = REMARKS
) -> Iterator[str]:
    """Noise that is far from what is stated, and whether a unit would explain it."""
    for report in reports:
        for q in report.quantities:
            found = q.noise_at_rest if q.noise_at_rest is not None else q.noise_in_motion
            if not q.stated or not found:
                continue
            ratio = found / q.stated
            # A platform in motion may shake faster than its instruments read; less than the stated
            # noise it cannot do.
            noisy = ratio >= settings.far and q.noise_at_rest is not None
            quiet = ratio <= 1 / settings.far
            if not (noisy or quiet):
                continue
            factors = FACTORS.get(q.unit, {}) if quiet else {}
            units = [
                unit
                for unit, factor in factors.items()
                if factor != 1 and abs(np.log(ratio * factor)) < settings.near_unit
            ]
            hint = f"; as if it read in {' or '.join(units[:3])}" if units else ""
            yield (
                f"run '{report.run}': {q.name.replace('_', ' ')} of {report.instrument} scatters by"
                f" {found:.2g} {q.unit}, {ratio:.2g} times the stated noise{hint}: check its unit,"
                " or correct 'noise'"
            )
