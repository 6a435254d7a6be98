"""From a motion that has been followed to a posterior: its parts, as those of a fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.identification.recursive.arriving.arrivals import Stuck
from steelyard.identification.recursive.arriving.spikes import forces_alone, motion_alone_in_words
from steelyard.identification.recursive.following import Following
from steelyard.identification.recursive.parts import counted_from, counted_up, motions_of
from steelyard.identification.recursive.window.walk import as_in_the_end, by_mass
from steelyard.identification.samples.faulty_stretches import stuck_in_words
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.border.segment_equations import SegmentEquations
from steelyard.identification.solve.conclusion import concluded
from steelyard.identification.solve.fitted import FittedStretch
from steelyard.identification.solve.noise_levels import ratios_of
from steelyard.identification.solve.posterior import Posterior, prior_of


def posterior_of(found: Following, *, courses: bool = True) -> Posterior:
    """All that follows, after the last motion has ended.

    Args:
        found: With all motions ended.
        courses: See :func:`.conclusion.concluded`.
    """
    fitted, recursion = found.begun, found.recursion
    here = recursion.state.calibration.values
    walk, passed = recursion.task.experiment.mass_walk, found.parts
    if not walk:
        # What has been learnt since moves the motion of then, too.
        passed = tuple(part.moved_to(recursion.point) for part in passed)
    parts = [counted_from(part, -here) for part in motions_of(passed)]
    if walk and parts:
        parts[-1] = _about_the_end(found, parts)
    tally, spent = counted_up(parts)
    state = replace(recursion.state, segments=tuple(part.segment for part in parts))
    fit = replace(
        fitted.fit,
        state=state,
        equations=(),
        tally=tally,
        ratios=ratios_of(recursion.task, spent, tally),
        turns=len(found.parts),
        converged=fitted.fit.converged and not recursion.unsettled and found.is_followed,
    )
    forces = tuple(part.force_samples for part in parts)
    alone, force = recursion.alone, found.like.forces.name
    notes = (
        *fitted.lost,
        *_of_stuck(found.stuck),
        *motion_alone_in_words(alone, force),
        *_of_walk(walk),
    )
    task = replace(recursion.task, experiment=_forgotten(recursion.task.experiment))
    spikes = forces_alone(alone, force)
    whole = replace(fitted, task=task, fit=fit, force_samples=forces, lost=notes, spikes=spikes)
    readings = Readings(
        found.experiment,
        recursion.state.calibration,
        found.experiment.runs,
        found.samples,
        (),
        recursion.task.settings,
    )
    return concluded([FittedStretch(readings, whole, tuple(parts))], courses=courses)


def _of_stuck(stuck: Mapping[str, Stuck]) -> Iterator[str]:
    """Notes of channels that were stuck after the beginning, which has its own.

    Args:
        stuck: Run -> its channels.
    """
    for run, channels in stuck.items():
        for (source, channel), (first, last) in channels.items():
            yield stuck_in_words(run, source, channel, first, last)


def _about_the_end(found: Following, parts: Sequence[SegmentEquations]) -> SegmentEquations:
    """The last of all parts, with what makes of their masses the last one.

    Args:
        found: With all motions ended.
        parts: With calibration parameters counted from where they are.
    """
    recursion, state = found.recursion, found.recursion.state
    assert state.parameters is not None
    experiment = _forgotten(recursion.task.experiment)
    radius = plausible_radius(experiment.robot)
    prior = prior_of(experiment, state.calibration, state.parameters, radius)
    told = recursion.relative(recursion.told)
    end = replace(told, normal=told.normal - prior.precision, right=told.right - prior.pull)
    own = [each.equations for each in parts]
    further = as_in_the_end(own, end, by_mass(recursion.point))
    return replace(parts[-1], equations=parts[-1].equations + further)


def _forgotten(experiment: Experiment) -> Experiment:
    """An experiment without what was known of a mass that has walked since: it is part of what is
    told of the last one.
    """
    if not experiment.mass_walk:
        return experiment
    loads = tuple(replace(each, known=_without_mass(each.known)) for each in experiment.loads)
    return replace(experiment, known=_without_mass(experiment.known), loads=loads)


def _without_mass(known: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """What is known of a body but its mass."""
    return {name: each for name, each in known.items() if name != "mass"}


def _of_walk(walk: float) -> Iterator[str]:
    """What a reader should know of a mass that walks."""
    if walk:
        yield (
            f"the mass walks at random by {walk:g} kg/sqrt(s), as stated: it is that at the end;"
            " what comes and goes is taken to be at the centre of gravity"
        )
