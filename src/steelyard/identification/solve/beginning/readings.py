"""The runs of an experiment, cut into segments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    gather,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.first_poses.first_motion import (
    FirstMotion,
    first_motion,
    lacks_pose,
    turns_are_told,
    with_first_motion,
)
from steelyard.identification.samples.preparation import prepare, with_every_cable
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.samples.segmentation import Recorded, recorded
from steelyard.identification.solve.settings import FIT, FitSettings

Tell = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Readings:
    """The runs of an experiment, cut into segments."""

    experiment: Experiment
    calibration: CalibrationValues
    """Values to begin with."""
    runs: tuple[Run, ...]
    """That were looked at."""
    samples: tuple[Samples, ...]
    """Of all runs."""
    records: tuple[Recorded, ...]
    """Of all runs."""
    settings: FitSettings = FIT

    @property
    def segments(self) -> tuple[Segment, ...]:
        """Of all runs, one after the other."""
        return tuple(segment for each in self.records for segment in each.segments)

    @property
    def force_samples(self) -> tuple[Forces, ...]:
        """Of each segment."""
        return tuple(forces for each in self.records for forces in each.force_samples)

    def looked_at(self, held_out: frozenset[str]) -> tuple[Forces | None, ...]:
        """Forces of each segment; None of runs that are held out."""
        return tuple(
            None if segment.run in held_out else forces
            for segment, forces in zip(self.segments, self.force_samples, strict=True)
        )

    @property
    def louder(self) -> dict[Source, float]:
        """Quantity -> by how much it scatters more than stated, to begin with."""
        found: dict[Source, float] = {}
        for each in self.records:
            for source, factor in each.louder.items():
                found[source] = max(found.get(source, 1.0), factor)
        return found

    @property
    def notes(self) -> list[str]:
        """What a reader should know of them."""
        return [note for each in self.records for note in each.notes]


def read(
    experiment: Experiment,
    start: CalibrationValues | None,
    tell: Tell,
    runs: Sequence[Run] | None = None,
    settings: FitSettings = FIT,
) -> Readings:
    """Cut the runs of an experiment into segments.

    Args:
        experiment: With at least one run.
        start: Values of the calibration parameters to begin with; None: as known beforehand.
        tell: Is called with what is being done and the fraction that is done.
        runs: Those to look at, or parts of them; None: all.
        settings: How to fit.

    Raises:
        InputError: A run lacks what the fit needs.
    """
    parameters = gather(experiment)
    runs = experiment.runs if runs is None else runs
    begun = {
        run.name: found
        for run in (with_every_cable(experiment, each) for each in runs)
        if lacks_pose(experiment, run)
        and turns_are_told(experiment, run)
        and (found := first_motion(experiment, run)) is not None
    }
    calibration = start or _first_values(parameters, begun)
    samples = []
    for i, run in enumerate(runs):
        tell(f"reading {run.name}", 0.2 * i / len(runs))
        poses = begun.get(run.name)
        samples.append(
            prepare(
                *(
                    (experiment, run)
                    if poses is None
                    else with_first_motion(experiment, run, poses)
                ),
                thin=True,
                calibration=calibration,
                commanded=True,
                settings=settings.motion.preparation,
            )
        )
    records = tuple(
        recorded(experiment, run, each, calibration, settings=settings.motion)
        for run, each in zip(runs, samples, strict=True)
    )
    return Readings(experiment, calibration, tuple(runs), tuple(samples), records, settings)


def _first_values(
    parameters: CalibrationParameters, begun: Mapping[str, FirstMotion]
) -> CalibrationValues:
    """What is known beforehand, and the offsets of lengths that nothing else tells a pose from."""
    values = parameters.mean.copy()
    for run, found in begun.items():
        for name, offset in found.offsets.items():
            values[parameters.place(name, "offset", run)] = offset
    return CalibrationValues(parameters, values)
