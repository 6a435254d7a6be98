"""Why not to rely on a calibration of the geometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.fit import GeometryFit
from steelyard.calibration.settings import CalibrationSettings
from steelyard.calibration.wrong_units import in_millimetres
from steelyard.estimates.quantiles import chi2_tail
from steelyard.robot.covariance import names_of


def reasons_against(found: GeometryFit, settings: CalibrationSettings) -> list[str]:
    """Sentences on what speaks against it; none where it can be relied on.

    Args:
        found: The fit.
        settings: Levels.
    """
    reasons = [
        *_of_convergence(found),
        *_of_departing_readings(found, settings),
        *_of_scattering_readings(found, settings),
        *_of_signs(found),
        *(found.parameters.weighed.reasons if found.parameters.weighed is not None else ()),
        *_of_the_datum(found),
        *_of_moves(found, settings),
    ]
    unit = in_millimetres(found.experiment) if reasons else ""
    return [unit, *reasons] if unit else reasons


def _of_convergence(found: GeometryFit) -> Iterator[str]:
    if not found.fit.converged:
        yield (
            f"the fit did not settle in {found.fit.turns} steps: the robot file is far from the"
            " readings; check the order of the cables, units and signs"
        )


def _of_departing_readings(found: GeometryFit, settings: CalibrationSettings) -> Iterator[str]:
    departing = sorted(_departing(found, settings), key=lambda each: -each[1])
    if departing:
        sizes = [f"{what} by {size:.1f}" for what, size in departing]
        yield (
            f"readings depart from all others, in their stated noise: {', '.join(sizes)}; check the"
            f" order of the cables, units, signs and 'noise'{_stretch(found)}"
        )


def _departing(found: GeometryFit, settings: CalibrationSettings) -> Iterator[tuple[str, float]]:
    """What scatters by more than its stated noise, and by how many times that."""
    fit = found.fit
    for source, ratio in fit.ratios.items():
        count = fit.tally.count.get(source, 0.0)
        if source not in fit.stated or count <= 1:
            continue
        size = ratio * fit.state.factors.get(source, 1.0) ** 2
        if size > 2 and chi2_tail(size * count, count) < settings.by_chance:
            name, quantity = source
            what = quantity.removesuffix(" at rest").replace("_", " ")
            yield f"{what} of {name}", float(np.sqrt(size))


def _stretch(found: GeometryFit) -> str:
    """That lengths of cables that stretch need tensions, where none were read."""
    if not found.experiment.robot.cable.axial_stiffness or found.body is not None:
        return ""
    return ", and add tensions: how far cables stretch is not known without"


def _of_scattering_readings(found: GeometryFit, settings: CalibrationSettings) -> Iterator[str]:
    """Of readings that scatter as no such instrument does, though nobody has stated their noise:
    what contradicts all others must not be taken for noise.
    """
    state, m, said = found.fit.state, found.experiment.robot.m, set()
    for segment in state.segments:
        for reading in segment.readings:
            label = segment.label(*reading.source)
            factor = state.factors.get(label, 1.0)
            if label in found.fit.stated or factor < settings.device or reading.source in said:
                continue
            said.add(reading.source)
            name, quantity = reading.source
            of = found.experiment.instruments[name].quantity(quantity, m)
            size = float(np.max(reading.sigma)) * factor
            yield (
                f"{quantity.replace('_', ' ')} of {name} scatters by {size:.2g}"
                f" {'rad' if of.rotation else of.unit}, as no such instrument does; check the order"
                " of the cables, units and signs, or state its 'noise'"
            )


def _of_signs(found: GeometryFit) -> Iterator[str]:
    instruments = found.experiment.instruments
    for place, entry, _ in found.parameters.components():
        drum = entry.key == "gain" and instruments[entry.owner].is_cable_motion
        if drum and found.ended.values[place] <= 0:
            yield (
                f"lengths of {entry.owner} fall where cables get longer; turn their signs"
                " ('scale: {l1: -1, …}' in the stream)"
            )
            return


def _of_the_datum(found: GeometryFit) -> Iterator[str]:
    datum = found.experiment.datum
    if datum is not None and any((w.run, w.row) == (datum.pose, 1) for w in found.wrong):
        yield (
            f"the first pose of run '{datum.pose}', which defines the world, contradicts all"
            " others; correct it, or name other poses or anchors under 'datum'"
        )


def _of_moves(found: GeometryFit, settings: CalibrationSettings) -> Iterator[str]:
    off = _moves(found)
    worst = int(np.argmax(np.abs(off))) if len(off) else 0
    if len(off) and abs(off[worst]) > settings.far_off:
        yield (
            f"{names_of(found.experiment.robot.m)[worst]} moves by {abs(off[worst]):.1f} of its"
            " 1-sigma beforehand; check the order of the cables and the unit of the robot file, or"
            " state a larger 'uncertainty'"
        )


def _moves(found: GeometryFit) -> Array:
    """Of the points over their 1-sigma beforehand, shape (6 m,); exact ones do not move."""
    parameters = found.parameters
    use = parameters.of_geometry
    moved = (found.calibration.values - parameters.mean)[use]
    before = parameters.deviation[use]
    return np.where(before > 0, moved / np.where(before > 0, before, 1.0), 0.0)
