"""Numbers that decide how a motion is designed, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DesignSettings:
    """How :func:`steelyard.design` chooses, searches and checks motions.

    With these values designs for CoGiRo, IPAnema 1, CAROCA and CoGiRo at three tenths of its size
    are tested by ``benchmarks/design.py``, designs on elastic cables in MuJoCo by
    ``benchmarks/designed_motion.py``.
    """

    # How fast a motion may be

    longest_duration: float = 120.0
    """Of one motion [s]: the search grows with it, and several runs do the same."""
    frequency_ratio: float = 5.0
    """Lowest natural frequency over the highest frequency of a motion, as it should be: the
    platform then follows quasi-statically to 4 %."""
    least_frequency_ratio: float = 2.5
    """The same, as it must be at least: below it, resonance enlarges the motion by a fifth."""
    usual_frequency: float = 0.4
    """Highest frequency of a motion where the stiffness of the cables is not known [Hz]: a fifth
    of the lowest natural frequency of CoGiRo, about 2 Hz."""
    largest_usual_frequency: float = 0.8
    """The same, as it may be at most [Hz]."""
    highest_frequency: float = 0.5
    """Of a motion that has the time, however stiff the cables are [Hz]: cable robots with
    workspaces of metres are not faster."""
    fewest_intervals: int = 5
    """Intervals between knots: fewer leave no free coefficient between rest and rest."""
    enough_intervals: int = 10
    """Intervals that a short motion has where the platform may move that fast: with fewer there is
    little to choose from."""
    limit_fraction_elastic: float = 0.85
    """Part of the limits on speed and acceleration that a command may use where cables are
    elastic: vibration adds up to the rest."""
    limit_fraction_stiff: float = 0.97
    """The same where they are not: the rest is for what lies between the instants of the search."""
    dunkerley_ratio: float = 1.4
    """Largest sum of the inverse squares of the natural frequencies on the way over that at the
    ends: the lowest frequency falls by about 16 %. High and tilted, that of CoGiRo falls from 2.4
    to
    1.2 Hz."""

    # What the platform may be, and where it may start

    start_grid: tuple[float, ...] = (0.0, -0.3, 0.3, -0.6, 0.6)
    """Positions that are tried as start along each axis, in half widths of the workspace."""
    tension_levels: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
    """Tensions near which the cables may be held, in parts of the highest allowed one; the lowest
    is taken that holds the platform almost everywhere."""
    grid_share: float = 0.9
    """Part of the poses of the start grid that "almost everywhere" asks for, of those that the
    best level can hold."""
    central_share: float = 0.5
    """The middle of the workspace is the start if its distance to the constraints is at least this
    part of the best one: users expect the middle."""

    # Vibration on elastic cables

    vibration_band: float = 0.7
    """Where the resonant band begins, in units of the lowest natural frequency: the square root of
    half the stiffness, which is known to a factor only."""
    vibration_level: float = 0.05
    """Root mean square of the vibration that a command may excite, in units of the limits on
    acceleration: without this bound CoGiRo's cables went slack in simulation."""
    vibration_instants: int = 10
    """Instants per interval at which it is evaluated: twenty per period of the fastest spline."""
    least_damping: float = 0.005
    """Damping ratio at least, so that resonance stays finite where the robot file says 0."""
    reference_acceleration: float = 3.0
    """Unit of vibration where acceleration has no limit [m/s^2]."""
    reference_angular_acceleration: float = 5.0
    """Unit of vibration where angular acceleration has no limit [rad/s^2]."""

    # Predicted information

    instants_per_knot: float = 2.0
    """Instants of the grid of readings per knot interval: the 1-sigma are then within 1 to 2 % of
    those of single readings (``docs/validation.md``)."""
    knots_per_interval: int = 2
    """Knot intervals of the estimator's motion per interval of the command: finer ones change the
    1-sigma by 1 to 2 %, which is within what is said of the end by all readings."""
    norm_power: float = 2.0
    """Power of the variances, in units of the target, whose norm is minimised: near to the
    largest, and still smooth and asking for all ten."""
    floor_repetitions: float = 1e6
    """Repetitions of an experiment after which only those variances are left that no motion
    lowers, such as by a gain that all force sensors share."""
    floor_share: float = 0.99
    """Part of that floor that is taken off the variances, so that all of them stay positive."""

    # The search

    steps: int = 50
    """Iterations of IPOPT at most, from each start."""
    starts_per_minute: float = 2.0
    """Random starts per minute of the budget: a search on CoGiRo for 20 s takes a quarter of a
    minute and more."""
    start_amplitude: float = 0.35
    """Amplitude of the random starts, in half widths of the workspace: large enough to be
    informative, small enough to be nearly feasible."""
    constraint_instants: int = 5
    """Instants per interval at which the constraints hold."""
    constraint_limit: float = 0.995
    """What constraints may reach at these instants; between them they may be a little larger."""
    accepted_excess: float = 0.01
    """By how much an iterate may exceed the constraints and still be kept for the case that the
    search is broken off; the motion is scaled afterwards."""
    end_excess: float = 0.02
    """By how much the end of a search may exceed the constraints; beyond it is scaled first."""
    tolerance: float = 1e-3
    """Of IPOPT, relative: 1-sigma are printed with three digits."""
    settled_change: float = 2e-3
    """Relative change of the objective that is no progress any more."""
    settled_steps: int = 6
    """Iterations in a row without progress after which a search ends."""
    memory: int = 20
    """Iterations that the limited-memory Hessian of IPOPT remembers."""
    search_share: float = 0.6
    """Part of the budget after which all searches end."""
    least_search_share: float = 0.2
    """Part of the budget that the searches of a run have at least."""
    fits_afterwards: float = 6.0
    """Time of what follows the searches, in noise-free fits, which a busy machine slows alike."""

    # Scaling of the result until all checks pass

    least_shrink: float = 0.995
    """Scale, at most, by which a motion that violates a limit is reduced."""
    largest_shrink: float = 0.7
    """Scale, at least."""
    blind_shrink: float = 0.95
    """Scale where the violated limit has no number."""
    shrink_margin: float = 0.998
    """By how much a scaled motion stays below the violated limit."""
    shrinks: int = 40
    """Reductions at most: with the weakest one it is 18 % in all."""
    enlargement: float = 3.0
    """Factor by which a random start is enlarged at most, where no search ended feasibly."""
    halvings: int = 7
    """Of the interval in which that factor is sought: 1 %."""

    # Checks of the result

    checks_per_second: float = 100.0
    """Instants at which limits are checked [Hz]: the rate of the commands."""
    body_checks_per_second: float = 20.0
    """The same for each of the bodies within the margin [Hz]: fifteen bodies, twice each."""
    stiffness_factors: tuple[float, ...] = (0.7, 1.4, 1.0)
    """Stiffness of the cables in units of the stated one, for the check on elastic cables: it is
    known to a factor only. The last one is what is shown."""
    elastic_tolerance: float = 1e-6
    """Of the integrator in that check [m], [rad]: ten times that of a simulation, since limits are
    compared and no readings made."""
    power_share: float = 0.99
    """Part of the power of the accelerations below the highest frequency that is reported."""
    sag_iterations: int = 3
    """Of tensions and sag, which depend on each other: three leave less than 1e-4 of the wrench on
    CoGiRo."""
    command_rate: float = 100.0
    """Of a command that states none [Hz]."""

    # Poses at rest for a calibration

    candidate_poses: int = 200
    """Poses that are drawn to choose from: twice as many make the mean 1-sigma of CoGiRo's anchors
    smaller by some three per cent."""
    smaller_turns: tuple[float, ...] = (0.5, 0.25, 0.0)
    """Parts of its angles with which a pose is tried again that the cables cannot hold as drawn."""
    grid_turn: float = 0.5
    """Angles of the regular grid that the choice is compared with, in half widths of the
    workspace."""
    exchanges: int = 10
    """Rounds of exchanges at most; three are usual."""
    exchange_gain: float = 1e-6
    """Gain of a round in the logarithm of the determinant that is no progress any more."""
    fewest_poses: int = 3
    """Of a calibration: with fewer no length tells anything but its offset."""
    most_poses: int = 100
    """Of a calibration: half of those that there are to choose from."""

    # Free swings

    fewest_swing_cables: int = 2
    """Of the sets of cables that are compared: on one a platform turns about it without a
    spring."""
    swing_places: int = 5
    """Places of rest to choose from: the middle and the farthest."""
    swing_places_tried: int = 30
    """Of the grid, to find these."""
    swing_taut: float = 0.05
    """Tension of every cable, at rest and in the swing, in parts of the largest one at rest, at
    least: a cable that may go slack is no cable of constant length."""
    swing_upright: float = 0.7
    """Least cosine of the angle by which the platform may hang askew, 45 degrees."""
    swing_of_length: float = 0.05
    """Largest amplitude in parts of the shortest cable: three degrees of a pendulum."""
    swing_of_size: float = 0.15
    """The same in parts of the platform's radius: nine degrees of turning."""
    swing_halvings: int = 4
    """How often the amplitude is halved where a cable would go slack."""
    frequency_share: float = 1e-3
    """1-sigma of a natural frequency in parts of it by which sets of cables are compared first:
    what ten seconds of motion capture give."""
    swing_rate: float = 25.0
    """Samples a second that the choice looks at [Hz]: ten in a period of swings of two hertz."""
    most_swings: int = 30
    """The prediction takes seconds each."""
    shortest_swing: float = 2.0
    """[s]: a few periods."""
    longest_swing: float = 120.0
    """[s]: swings have died away."""

    # Reference bodies

    reference_shares: tuple[float, ...] = (0.05, 0.2, 0.5, 1.0)
    """Masses of weighed bodies that are added, in parts of what the platform carries."""
    replacing_shares: tuple[float, ...] = (0.5, 1.0)
    """The same of those that are carried in its place, as a whole: lighter ones are seldom held."""
    reference_place: float = 0.005
    """1-sigma of each coordinate of where a reference is fastened [m]: by a tape."""
    reference_density: float = 7800.0
    """Of references [kg/m^3]: balls of steel."""
    motion_instants: float = 10.0
    """Instants per second through which a recorded motion is made again [Hz]."""


DEFAULT = DesignSettings()
"""What is used where nothing is given."""
