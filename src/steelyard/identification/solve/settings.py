"""Numbers that decide how motion, body and calibration are fitted, with the reason of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from steelyard.identification.model.settings import MOTION, MotionSettings


@dataclass(frozen=True)
class FitSettings:
    """How :class:`steelyard.MaximumLikelihood` and the linear methods fit.

    With these values the methods are within 3 % of the Cramer-Rao bound in
    ``benchmarks/studies.py`` and on the recordings of ``benchmarks/accuracy.py``.
    """

    motion: MotionSettings = MOTION
    """Of segments, knots and smoothness."""

    # Steps of Gauss and Newton

    iterations: int = 45
    """At most: sound recordings need 5 to 12, swings on few cables up to 40."""
    iterations_beginning: int = 12
    """The same where the fit is only a beginning for another one."""
    first_body_iterations: int = 3
    """Of the body that a fit begins with: each weighs samples that stand far anew."""
    shorter: float = 0.3
    """Part of the reach of a step that is tried where the whole one does not descend."""
    farther: float = 2.5
    """By how much steps that are held back reach farther after one that kept its promise, and less
    far after one that did not."""
    well_kept: float = 0.7
    """Part of the promised decrease of the cost that is a promise kept."""
    badly_kept: float = 0.25
    """The same that is one not kept."""
    least_reach: float = 0.02
    """Of the border in plausible sizes and prior 1-sigma: what moves less leaves the motion alone
    to step too far."""
    uphill: int = 1
    """Steps that may go on from where the cost has risen, before a shorter one is tried: a curved
    valley is left by its tangent and reached again by the next step [Chamberlain1982]_."""
    least_share: float = 1e-3
    """Part of a step below which there is no more to try."""
    border_arrived: float = 0.02
    """Promised decrease of the cost by body and calibration, a chi-square, at which they have
    arrived: .14 of a 1-sigma in the worst direction."""
    arrived: float = 0.5
    """The same by all coefficients of the motion."""
    beginning_arrived: float = 5.0
    """The same of a motion that is only a beginning."""
    slow: float = 0.4
    """Part of a step that the next one is, above which steps are a slow geometric series."""
    least_pace: float = 0.05
    """Of such a series, in parts of a step [Aitken1926]_."""
    largest_pace: float = 2.5
    """The same, at most."""
    same_cost: float = 1e-6
    """Relative increase of the cost that is none: rounding and Huber's weights."""

    # Levels of noise

    level: float = 0.04
    """Largest relative change of a level at which it has settled: a 1-sigma of 4 %."""
    faster: float = 1.5
    """By how much the steps of a level that creeps grow from one iteration to the next."""
    fastest: float = 10.0
    """The same, at most in all."""
    most_change: float = 2.0
    """Of the logarithm of a level in one iteration."""
    nearly_arrived: float = 2e-3
    """Part of the cost that a step may still promise where a stated noise is looked at."""
    larger: float = 1.3
    """Readings that scatter by so much more than their stated noise do not count as if they were
    as stated."""
    least_freedom: float = 0.02
    """Part of the readings that is left to tell their noise, at least."""

    # What is identifiable

    least_information: float = 0.25
    """On a direction in units of plausible sizes and prior 1-sigma: one that is known no better
    than to twice its plausible size is not identifiable."""
    beyond_noise: float = 3.0
    """Information in units of what noise of the motion alone would leave, below which a direction
    is not identifiable: a motion at rest has one, a single move from rest to rest six."""
    held: float = 1e3
    """By how much such a direction is held more firmly than the best known one."""
    significant: float = 0.95
    """Quantile of the chi-square within which a scatter of stretches or runs is chance."""
    tells: float = 1e-4
    """Part of what is known in a direction that readings must tell, so that their scatter there is
    looked at: the noise of less is a hundredth of the 1-sigma, below the curvature of the model."""

    # Held motion

    held_iterations: int = 12
    """At most: sound recordings need 3 to 5."""
    bias_iterations: int = 2
    """After so many the body is near enough for what noise of the motion does to it."""
    level_iterations: int = 4
    """After so many the noise of the readings is as it will be."""
    held_arrived: float = 0.05
    """Largest step of one of the ten, in its 1-sigma, at which they have arrived."""
    moving: float = 0.15
    """Largest 1-sigma of a direction of the ten that takes steps, as a part of its plausible size:
    what is known worse is held at zero, for a wild value of it is paid for by calibration
    parameters."""
    held_share: float = 0.25
    """Least part of a step where steps go to and fro."""
    bias_draws: int = 2
    """Of the noise of the motion; each is of all instants, so two tell its mean effect to some per
    cent."""
    stretch_iterations: int = 4
    """Of the motion of a window of a long recording."""

    # Readings that stand out

    far_off: float = 10.0
    """Prior 1-sigma beyond which a calibration parameter by the motion alone is no beginning."""
    alone: float = 5.0
    """Correction of one force reading, in its own 1-sigma, beyond which it is held against all
    others."""
    contact_pause: float = 0.3
    """Longest pause between samples of one contact [s]."""
    contact_margin: float = 0.15
    """What is left out before and after a contact [s]: it begins and ends softly."""
    contact_samples: int = 3
    """That make a contact."""
    most_cut: float = 0.25
    """Part of a run beyond which contacts are not cut: what is the rule is no exception."""
    slack: float = 0.02
    """Tension of a cable that nobody reads, as a part of all tensions, below which it may be slack:
    motion capture tells it to one or two hundredths."""
    slack_margin: float = 0.1
    """What is left out before and after a cable is slack [s]: the knots on either side of a jerk;
    with half of it the 1-sigma of the body are still too small by half."""
    hand_window: float = 0.25
    """Over which the residual of a swing without force sensors is averaged [s]: shorter than a
    push, longer than noise of the motion goes on."""
    hand: float = 6.0
    """That residual, in units of its median, that is a hand: swings make it up to 3."""
    hand_around: float = 3.0
    """The same before and after: a hand comes and goes softly."""
    hand_turns: int = 3
    """Times at most that hands are looked for, each about the body that the rest tells."""
    most_touched: float = 0.5
    """Part of a swing beyond which nothing is left out for a hand."""
    cuts: int = 4
    """Fits at most between which readings that stand out are left out."""
    lost_samples: int = 5
    """Motion readings in a row that stand far from the motion: the instrument has lost it."""
    lost_margin: int = 2
    """Readings beside these that go with them."""
    lost: float = 4.5
    """Root of a whitened residual under Huber's weight that is far beyond what noise may reach."""

    # Vibrations that the knots do not follow

    coherent: float = 0.3
    """Correlation of the residuals of forces and accelerometer that is a motion."""
    much_finer: float = 0.7
    """Spacing that the instruments could resolve, in parts of the present one, that is worth a
    second fit."""
    finer_turns: int = 3
    """Times that knots are halved where forces ask for it, at most: to an eighth."""
    surely_larger: float = 3.0
    """1-sigma by which a variance is beyond that of stated noise, in that of a variance of so many
    numbers, where finer knots are tried."""
    steps_to_explain: int = 5
    """Steps of the motion on finer knots, at most, after which they have to explain it."""
    hardly: float = 0.9
    """Part of the cost that a step leaves after which further ones change little."""
    explained: float = 0.5
    """Part of the variance of what is left of the forces beyond their noise that finer knots leave,
    at most, where they are what is missing: each halving takes all but some hundredths of the error
    of a spline, and nothing of noise."""
    coherence_lag: float = 0.05
    """Largest lag between the two [s]."""
    coherence_chance: float = 6.0
    """Correlation that chance reaches at any lag, times the root of the number of samples."""

    # Errors that good devices do not have

    suspicious: float = 4.0
    """Standard normal score from which such an error is estimated: one in a thousand sound
    recordings, over all of them."""
    needless: float = 3.3
    """Standard normal score below which one is none after all, beside processes that came later:
    one that is there is not to be lost for a score just below the former, to be named by the
    verdict."""
    suspicions: int = 3
    """Times that this is looked at: one error may stand in for another."""

    # Disturbances along the motion

    correlations: tuple[float, ...] = (0.02, 0.05, 0.2, 1.0, 5.0)
    """Correlation times at which residuals are tested for colour [s]."""
    coloured: float = 4.0
    """Standard normal score of their correlation from which a process is tried: one in a thousand
    sound recordings, over all axes and times. Whether it stays is decided by its likelihood."""
    asked_for: float = 6.9
    """Gain of the log likelihood by which a process stays: half the chi-square of two at 1e-3."""
    most_processes: int = 4
    """That are tried one after the other."""
    level_fits: int = 3
    """Of motion and levels in turn, for each of them."""
    largest_disturbance: Mapping[str, float] = field(
        default_factory=lambda: {"m": 0.1, "rad": 0.3, "rad/s": 0.1, "m/s^2": 0.5}, hash=False
    )
    """Unit -> rms of a disturbance of an instrument that nobody has stated, beyond which it is no
    drift, filter or lost target but an error of the description."""
    largest_drift: float = 0.1
    """1-sigma of coloured noise of forces that nobody has stated, at most, over what they usually
    read."""
    level_settled: float = 0.2
    """Largest logarithm of a change of level at which these have settled."""

    # What is tried where a fit does not arrive

    left_out: int = 2
    """Instruments of which one is left out then, one after the other: each costs a fit."""

    # Jitter of time stamps

    jittering: float = 6.0
    """Standard normal score of residuals that are larger where the readings change quickly, from
    which stamps are taken to scatter: residuals have longer tails than squares of normal
    numbers."""
    least_jitter: float = 0.3
    """What stamps that scatter must make of the noise of a reading at least: less is a twentieth of
    its variance."""
    jitter_bound: float = 5.0
    """Residual in units of their root mean square that a single one counts for at most."""

    # Blocks of residuals and long recordings

    block: float = 1.0
    """Least length of the stretches that are held against each other [s]."""
    block_spacings: float = 5.0
    """The same in spacings of the knots: neighbours share their motion."""
    most_blocks: int = 60
    """Of a segment: more tell no more about their scatter."""
    long_jointly: float = 900.0
    """Length of recording beyond which motion and forces are fitted window by window too [s]: what
    they take of memory grows by 1.6 MiB a second at some hundred samples a second."""
    part_jointly: float = 240.0
    """Length of it that tells calibration, noise and smoothness first [s]: the step from there to
    what the whole says is one of a few 1-sigma of the whole, and linear."""
    long_block: float = 10.0
    """Least length of the stretches that are held against each other then [s]."""
    most_long_blocks: int = 120
    """Of such a recording: those of an hour would take as much memory as its readings."""
    most_passes: int = 3
    """Through the windows: one where the step is small, more where it is not."""
    small_step: float = 10.0
    """Largest step of a pass, in 1-sigma of the whole, that is linear: in ten minutes about two of
    them a second pass moved the ten by a hundredth."""
    long: float = 180.0
    """Length of recording beyond which the linear methods fit it window by window [s]: the memory
    that a fit takes grows by some MiB a second."""
    part: float = 40.0
    """Length of a long recording that tells calibration, noise and smoothness first [s]."""
    shortest_part: float = 3.0
    """Least length of it from each run [s]."""
    well_read: float = 0.9
    """Share of the readings that a part has at least where any other of its length has all: what is
    lively while a tracker has lost its target tells little."""
    window: float = 60.0
    """Of a long recording [s]."""
    jobs: int = 1
    """Processes that work at a time on the windows of one: they say the same whatever their
    number."""

    def with_looser_motion(self, looser: float) -> FitSettings:
        """The same with a motion that may do more, see :attr:`.MotionSettings.looser`."""
        return replace(self, motion=replace(self.motion, looser=looser))


FIT = FitSettings()
"""What is used where nothing is given."""
