"""What pulls at the platform and the model does not know: disturbances that are larger than devices
and surroundings make.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import UNMODELLED_PARTS, balance_of
from steelyard.identification.model.calibration_parameters import ATTACHED, BENDING_KEYS, ROBOT
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import Process
from steelyard.identification.solve.misfits.along_segments import (
    disturbed_readings,
    every_along,
    root_mean_square,
    unstated_along,
)
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VerdictSettings
from steelyard.inertia import Inertia


def of_disturbances(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Disturbances that nobody has stated and that are larger than devices and surroundings
    make.
    """
    robot = posterior.experiment.robot
    weight = abs(float(posterior.parameters[0])) * float(np.linalg.norm(robot.gravity))
    for segment in posterior.fit.state.segments:
        if posterior.experiment.moves_within(segment.run):
            yield from _of_what_moves(segment, robot.size, weight, settings)
        for process, along in unstated_along(segment):
            rms = root_mean_square(along)
            owner, name = process.disturbs
            part = UNMODELLED_PARTS.get(process.source)
            if part is None:
                instrument = posterior.experiment.instruments[owner]
                quantity = instrument.quantity(name, robot.m)
                columns, unit = quantity.forms[0], quantity.unit
                for i in _against_motion(segment, process, settings):
                    yield (
                        f"run '{segment.run}': {columns[i]} of {owner} reads against the motion"
                        f" that all others show; correct its sign (scale: {{{columns[i]}: -1}}),"
                        " or the order of its columns"
                    )
                largest = settings.largest_disturbance.get(unit, np.inf)
                if instrument.is_force:
                    # A wrench of that size would be no disturbance either.
                    largest = settings.largest_wrench * weight
                if rms.max() > largest:
                    yield (
                        f"run '{segment.run}': {name.replace('_', ' ')} of {owner} departs for a"
                        f" while from what all others show, by {rms.max():.2g} {unit} rms, which"
                        " is more than devices drift; check its axes, signs, units and 'sync', or"
                        " state it under 'noise'"
                    )
                continue
            arm, unit = (1.0, "N") if part.start == 0 else (robot.size, "N m")
            if rms.max() > settings.largest_wrench * weight * arm:
                yield (
                    f"run '{segment.run}': an {name} that nothing explains is as large as"
                    f" {rms.max():.2g} {unit} rms, a large part of the weight; check the geometry"
                    " of the robot, the order and the signs of its forces, and what touches the"
                    f" platform, or state it under 'uncertainty: {{unmodelled: …}}'"
                )
            pulls = float(np.linalg.norm(root_mean_square(_beside_its_line(along))))
            if part.start == 0:
                yield from _of_short_motion(posterior, segment, pulls, settings)
                continue
            turning = _turning(posterior, segment.run)
            # What drifts does not follow a platform that turns to and fro.
            if pulls > settings.largest_torque * turning:
                # It is taken as independent of the motion. What is not is in the moments of
                # inertia, the more, the larger it is beside what they withstand.
                yield (
                    f"run '{segment.run}': an {name} that nothing explains is as large as"
                    f" {pulls / max(turning, 1e-300):.0%} of the torque that turns the"
                    " platform, so that the inertia may be off by more than its 1-sigma; turn the"
                    " platform faster, remove what pulls at it, or state it under 'uncertainty:"
                    " {unmodelled: …}'"
                )


def of_imitations(posterior: Posterior) -> Iterator[str]:
    """A hose and parts that bend, of which nobody has stated either: a load that swings below its
    frequency answers as something that bends, above it as something that pulls back.

    Args:
        posterior: With the errors that its readings ask for.
    """
    asked = posterior.asked_for
    if asked & set(BENDING_KEYS) and any((ROBOT, key, None) in asked for key, _ in ATTACHED):
        yield (
            "something seems to pull at the platform like a hose and parts of it to bend, as a load"
            " that swings does; fix what hangs on the platform, or state what is there ('attached:"
            " […]', 'bending: {frequency: …}')"
        )


def _of_what_moves(
    segment: Segment, size: float, weight: float, settings: VerdictSettings
) -> Iterator[str]:
    """What moves in a load that pulls harder than it weighs: it stands for something else."""
    for process, along in every_along(segment):
        part = UNMODELLED_PARTS.get(process.source)
        if part is None:
            continue
        arm, unit = (1.0, "N") if part.start == 0 else (size, "N m")
        rms = root_mean_square(along)
        if rms.max() > settings.largest_pull * weight * arm:
            yield (
                f"run '{segment.run}': what moves in the load would pull with {rms.max():.2g}"
                f" {unit} rms, a large part of the weight; check the geometry of the robot, the"
                " order and the signs of its forces"
            )


def _against_motion(segment: Segment, process: Process, settings: VerdictSettings) -> list[int]:
    """Components of a quantity that change with the opposite sign of what the motion has there:
    slow and small ones are not seen before the fit, and coloured noise of twice their size takes
    them up.

    Args:
        segment: With the motion.
        process: That disturbs the quantity.
        settings: How surely, and how far beyond its noise.
    """
    found = set[int]()
    for reading, _, read, departs in disturbed_readings(segment, process):
        if len(read) < settings.fewest_readings:
            continue
        moved = read - departs
        read, moved = read - read.mean(axis=0), moved - moved.mean(axis=0)
        size = np.sqrt(np.mean(read**2, axis=0))
        alike = np.mean(read * moved, axis=0) / np.maximum(size * moved.std(axis=0), 1e-300)
        seen = size > settings.seen_above_noise * reading.sigma
        found |= set(np.flatnonzero(seen & (alike < -settings.against)).tolist())
    return sorted(found)


def _of_short_motion(
    posterior: Posterior, segment: Segment, pulls: float, settings: VerdictSettings
) -> Iterator[str]:
    """An unmodelled force that may be a load that swings, of which a motion is too short to tell.

    Args:
        posterior: With its body.
        segment: The motion.
        pulls: Root mean square of the force [N].
        settings: With what is short, and large.
    """
    duration = float(np.ptp(segment.span))
    if duration >= settings.short:
        return
    accelerating = _accelerating(posterior, segment.run)
    if pulls > settings.largest_force * accelerating:
        yield (
            f"run '{segment.run}': an unmodelled force that nothing explains is as large as"
            f" {pulls / max(accelerating, 1e-300):.0%} of the force that accelerates the platform,"
            f" and {duration:.0f} s of motion do not tell whether something swings on it; record"
            f" {2 * settings.short:.0f} s, or remove what pulls at it"
        )


def of_contacts(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """An unmodelled force that goes on between many contacts and is not much smaller than they: it
    is the same thing, of which only the largest moments were left out.
    """
    force = next(iter(UNMODELLED_PARTS))
    fit = posterior.fit.state
    assert fit.parameters is not None
    for segment, forces in zip(fit.segments, posterior.force_samples, strict=True):
        times = posterior.contacts.get(segment.run, ())
        touched = forces.touched
        processes = () if segment.static else segment.processes_of(force)
        if len(times) < settings.many_contacts or not touched.any() or not processes:
            continue
        at = balance_of(
            posterior.experiment, segment, forces, fit.calibration, fit.parameters, fit.factors
        )
        between = np.linalg.norm(at.disturbance[:, :3], axis=1)
        there = np.linalg.norm((at.left_over + at.disturbance)[:, :3], axis=1)
        usual, at_contacts = (
            float(np.sqrt(np.mean(each**2))) for each in (between[~touched], there[touched])
        )
        if usual > settings.contacts_stand_out * at_contacts:
            yield (
                f"run '{segment.run}': something seems to touch the platform {len(times)} times"
                f" with {at_contacts:.2g} N, and {usual:.2g} N rms go on between: that is one"
                " thing rather than many, such as a load that swings, a hose or a guide; fix it or"
                " take it off"
            )


def scatter_beside(posterior: Posterior) -> float:
    """Variance that the unmodelled wrench and coloured noise of the forces make beside the
    residual, in units of the noise of the forces: noise that goes on for a while is taken up by
    them, so that less of it is left over.
    """
    fit, square, count = posterior.fit.state, 0.0, 0
    assert fit.parameters is not None
    for segment, forces in zip(fit.segments, posterior.force_samples, strict=True):
        at = balance_of(
            posterior.experiment, segment, forces, fit.calibration, fit.parameters, fit.factors
        )
        taken_up = np.einsum("nij,nj->ni", at.whitener, at.by_processes)
        square += float(np.sum(taken_up**2))
        count += taken_up.size
    return square / max(count, 1)


def _beside_its_line(along: Array) -> Array:
    """Something at even instants less the straight line through it, shape (t, p)."""
    time = np.linspace(-1.0, 1.0, len(along))
    line = np.stack([np.ones_like(time), time], axis=1)
    found, *_ = np.linalg.lstsq(line, along, rcond=None)
    return np.asarray(along - line @ found)


def _accelerating(posterior: Posterior, run: str) -> float:
    """Root mean square of the force that accelerates the body in a run [N]."""
    mass, gravity = abs(float(posterior.parameters_in(run)[0])), posterior.calibration.gravity
    found = []
    for each in posterior.samples:
        if each.run == run and len(each) and each.rotation is not None:
            found.append(np.einsum("nij,nj->ni", each.rotation, each.specific_force) + gravity)
    return (
        mass * float(np.sqrt(np.mean(np.sum(np.concatenate(found) ** 2, axis=1)))) if found else 0.0
    )


def _turning(posterior: Posterior, run: str) -> float:
    """Root mean square of the torque that turns the body about its centre of gravity in a run
    [N m].
    """
    body = Inertia.from_parameters(posterior.parameters_in(run)).inertia
    found = [
        each.alpha @ body + np.cross(each.omega, each.omega @ body)
        for each in posterior.samples
        if each.run == run and len(each)
    ]
    return float(np.sqrt(np.mean(np.sum(np.concatenate(found) ** 2, axis=1)))) if found else 0.0
