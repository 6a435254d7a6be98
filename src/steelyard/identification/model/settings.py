"""Numbers that decide how readings become samples on one time base, and a motion in continuous
time, with the reason of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PreparationSettings:
    """Of samples on one time base: for ``two-step``, and for a motion to begin with."""

    fewest: int = 10
    """Samples of a run in motion."""
    margin: float = 1.0
    """Of a stream beside the window of its run [s]: clocks may still be moved."""

    # The filter

    finest: float = 0.02
    """Least spacing of the knots of a motion to begin with [s]: it passes 25 Hz, which is all that
    a platform on cables does."""
    widest: float = 0.5
    """Largest spacing of the knots [s]: it passes 1 Hz, which any motion worth recording has."""
    fewest_knots: float = 8.0
    """Spacings in a run, at least."""
    samples_per_knot: float = 2.0
    """Of the slowest stream, so that its samples determine every spline."""
    judged: float = 30.0
    """Length of the part on which the spacing is chosen [s]."""
    evaluated_per_knot: float = 4.0
    """Samples between two knots that hold all that the filter has let through."""

    # What is a motion

    least_turning: float = 1e-3
    """Angular acceleration of a platform in motion, rms [rad/s^2]."""
    beyond_noise: float = 3.0
    """The same, in 1-sigma of its noise."""
    least_moving: float = 0.05
    """Change of the specific force of a platform in motion, rms [m/s^2]."""

    # Gyro against attitude

    least_compared: float = 0.05
    """Angular velocity about an axis at which they are compared, rms [rad/s]."""
    largest_factor: float = 0.5
    """Difference of their ratio from one that neither misalignment nor vibration explains."""


PREPARATION = PreparationSettings()


@dataclass(frozen=True)
class MotionSettings:
    """Of segments, their knots and their smoothness."""

    preparation: PreparationSettings = PREPARATION
    """Of the motion to begin with."""

    # Segments

    gap: float = 0.5
    """Longest stretch without a reading of the rotation, or of the translation, that a motion is
    carried over [s]: half a period of the slow motions that platforms make."""
    shortest: float = 1.0
    """Least length of a segment [s]: below it the ends, which one side tells, are most of it."""
    lost: float = 0.1
    """Stretch without a reading after which a target counts as lost [s]: trackers find one again in
    tenths of a second at best."""
    margin: float = 0.1
    """Of the knots beyond the first and the last reading [s]: clocks may still be moved."""
    least_noise: float = 1e-4
    """Of a quantity that scatters by nothing but rounding, as a part of how much it varies: no
    sensor resolves more."""
    finest_noise: float = 1e-7
    """The same of a quantity whose noise is stated: squares of less are lost in the rounding of
    normal equations."""
    least_jerk: float = 1e-2
    """Mean square of a third derivative to begin with, at least [m^2/s^6], [1/s^6]: where nothing
    tells the place, it begins as if at rest."""
    commanded_position: float = 0.02
    """1-sigma of how far a platform is from its commanded place, where that stands in for a
    measurement [m]: what winches and elastic cables leave."""
    commanded_orientation: float = 0.02
    """The same of its orientation [rad]."""
    commanded_rate: float = 0.1
    """Readings of a command a second that count as independent [Hz]: it is wrong for a while where
    it is wrong."""

    # Dense streams

    averaged_over: float = 1e-3
    """Longest time that samples are averaged over, on cables [s]: a vibration of 25 Hz, which is
    all that a platform on cables does, loses a thousandth of its amplitude."""
    averaged_over_on_sensor: float = 2.5e-4
    """The same on a wrench sensor [s]: of 100 Hz, likewise."""
    needed_in_group: float = 0.75
    """Part of the samples of a mean that have to be there: its noise is at most a seventh more than
    that of all."""
    lost_in_groups: float = 0.2
    """Part of all samples that gaps may lose between groups: of a stream with more gaps every
    sample is looked at."""
    usual_in_group: float = 0.99
    """Part of the samples whose distance from the median of their group is usual: at that of normal
    noise, 2.6 of its 1-sigma."""
    alone_in_group: float = 3.0
    """Usual distances beyond which a sample stands alone: 8 of 1-sigma, which normal noise never
    reaches."""

    # Spacing of the knots

    finest: float = 0.02
    """On cables [s]: platforms on cables move below 25 Hz."""
    finest_on_sensor: float = 0.005
    """On a wrench sensor [s]: arms vibrate up to 100 Hz."""
    swinging: float = 0.04
    """Largest spacing where no force is read [s]: platforms swing with up to 4 Hz, of whose
    accelerations these knots pass all but some thousandths."""
    widest: float = 0.45
    """[s]: about a second of motion between knots tells nothing about accelerations."""
    judged: float = 20.0
    """Length of the stretch on which the spacing is chosen [s]."""
    per_knot: float = 2.0
    """Samples between two knots, at least: a motion that its instruments do not resolve cannot be
    told from their readings, and the forces, which would tell it instead, could then say nothing
    about the body."""
    shaken: float = 3.0
    """Scatter of rates and accelerations about a spline of their own, over their stated noise, from
    which on a drive or the frame shakes the sensor: a fit begins with that scatter."""
    humming: float = 2.0
    """The same of forces from one sample to the next."""
    most_shaken: float = 300.0
    """The same at most: no drive shakes a platform by a g for good, and what scatters more beside
    its stated noise has that in another unit."""
    finer: float = 2**0.5
    """By how much the knots are closer than the readings of the motion ask for: what these do not
    see, forces may."""
    finer_stretched: float = 2.0
    """The same where lengths are read of cables that stretch much: a spline errs in accelerations
    with the fourth power of its spacing, and then errs by a quarter of that."""
    much_stretched: float = 20.0
    """How far cables stretch, in 1-sigma of the lengths that are read of them, that is much: knots
    that the motion alone asks for leave up to a hundredth of it, a fifth of that noise and in
    readings that follow each other alike."""
    per_vibration: float = 3.0
    """The same of the accelerometer where it is to follow a vibration."""

    # Likelihood of a spacing

    undamped: float = 10.0
    """Prior 1-sigma of the polynomials that a prior on the third derivative leaves free, in units
    of how far the readings vary: it hardly holds them, and stays a proper prior."""
    unstated_noise: float = 1e-3
    """Noise that is not stated, to begin with, in the same units."""
    first_jerk: float = 1e-3
    """Intensity of the third derivative to begin with, in the same units and those of the spacing:
    the search goes nine orders of magnitude to both sides."""
    jerk_range: tuple[float, float] = (1e-9, 1e9)
    """Of the intensity about that beginning: wider than any motion asks for."""
    jerk_tolerance: float = 0.3
    """Of the logarithm of the intensity: the likelihood is flat at its maximum."""
    jerk_iterations: int = 20
    """Evaluations of the likelihood in that search at most: it needs 6 to 16."""
    much_wider: float = 3.0
    """Ratio of the spacing that all but places ask for to that which places ask for, at least."""
    no_motion: float = 100.0
    """Log likelihood by which finer knots are worse for rates and accelerations, from which what
    asks for them is no motion."""
    as_likely: float = 2.0
    """Log likelihood by which a wider spacing may be worse and is still taken: odds of 7 to 1,
    which are no strong evidence for finer knots [Kass1995]_."""

    # Poses at rest

    place_at_rest: float = 1e-3
    """First guess of the noise of a place where none is stated [m]."""
    angle_at_rest: float = 3e-3
    """The same of an orientation [rad]."""
    specific_force_at_rest: float = 0.03
    """The same of a specific force [m/s^2]."""
    rate_at_rest: float = 3e-3
    """The same of an angular velocity [rad/s]."""
    best_at_rest: float = 10.0
    """By how much it may be better than that: two instruments at rest cannot tell which of them is
    the better one."""

    # Smoothness

    looser: float = 30.0
    """By how much more a motion that its instruments resolve is let do than it does on average:
    where it rings, its roughness sits in narrow bands, far above the mean, and a prior that is too
    stiff there takes from the acceleration what the forces measure. It widens what passes by
    30^(1/6), less than twofold."""
    looser_jointly: float = 1e3
    """The same where forces, motion and body are fitted at once: what a prior takes of the motion
    stays in what is left of the forces and goes with the motion, as parts that bend do; between
    knots that the readings have chosen nothing is gained by it."""
    looser_swinging: float = 30.0
    """The same of a platform that swings, whose motion its own equations hold."""
    smoothness_settled: float = 0.3
    """Largest logarithm of the ratio of two intensities at which they have settled: the frequency
    that passes follows it with a sixth of that, 5 %."""
    smoothness_iterations: int = 12
    """At most: recordings need 1 to 7."""
    smoothness_step: float = 4.0
    """Longest step of the logarithm of an intensity: a factor of 55."""
    smoothness_slopes: tuple[float, float] = (-1.5, -0.15)
    """Of the logarithm of the ratio by that of the intensity, as far as a secant is believed: -1
    where roughness and freedom do not depend on it."""
    stiffer: float = 1e-3
    """Second beginning of a search, as a part of the first: there may be two answers, one of them a
    motion that follows the noise."""
    least_used_freedom: float = 0.1
    """Degrees of freedom that the readings use of a motion, at least, so that the ratio of its
    roughness to them is finite."""
    least_position_intensity: float = 1e-4
    """Intensity that no motion is stiffer than [m^2/s^5]: within a second its acceleration may
    always change by a centimetre per second squared. Where nothing seems to move, the readings
    would else ask for none at all."""
    least_rotation_intensity: float = 1e-5
    """The same of the orientation [1/s^5]."""

    @property
    def least_intensity(self) -> Mapping[str, float]:
        """Part of the pose -> intensity that it has at least."""
        return {
            "position": self.least_position_intensity,
            "rotation": self.least_rotation_intensity,
        }

    def at_rest(self, unit: str) -> float:
        """First guess of the noise of a quantity at rest, by its unit."""
        return {
            "m": self.place_at_rest,
            "rad": self.angle_at_rest,
            "m/s^2": self.specific_force_at_rest,
            "rad/s": self.rate_at_rest,
        }[unit]

    # Processes

    shortest_correlation: float = 0.02
    """Correlation time [s] below which a disturbance is white noise at the rates of real
    sensors."""
    longest_correlation: float = 1000.0
    """Correlation time [s] above which it is a constant."""
    least_level: float = 1e-3
    """1-sigma with which a search of a level begins at least, in units of the noise."""
    level_range: float = 1e3
    """By how much a level may differ from where its search begins."""
    level_slope: float = 0.05
    """Of the logarithm of the marginal likelihood by those of levels and correlation times, at
    which they have arrived: they are known to tenths at best."""
    level_gain: float = 3e-6
    """The same by the relative gain of a step: hundredths of some ten thousand."""
    level_trials: int = 40
    """Evaluations of the marginal likelihood at most."""
    no_level: float = 1e-4
    """Part of a level that is as good as none."""


MOTION = MotionSettings()
"""What is used where nothing is given."""
