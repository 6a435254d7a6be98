"""Numbers that decide whether an estimate is accepted, with the reason of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from steelyard.identification.solve.settings import FIT


@dataclass(frozen=True)
class VerdictSettings:
    """Levels of the verdict.

    With these values none of a hundred sound recordings is rejected, and all wrong descriptions of
    ``benchmarks/studies.py`` are.
    """

    family: float = 1e-3
    """Probability that any of the directed tests rejects a sound recording [Dunn1961]_."""
    matters: float = 1.0
    """Least shift of the estimate, in its 1-sigma, that an error of the description is held against
    it for."""
    implausible: float = 8.0
    """1-sigma of its prior beyond which an error that nobody has stated is not that of any device,
    though the estimate may not move with it: the fit has taken up something else by it."""
    twice: float = 4.0
    """A variance beyond this factor of what is stated or explained is not just a noise stated
    roughly: twice the 1-sigma."""
    much_less: float = 0.1
    """A variance below this part of what is stated is a wrong unit rather than a good sensor."""
    by_chance: float = 1e-5
    """Probability below which a residual is not what it is by chance."""
    informed: float = 0.98
    """Part of its prior variance that an error must have lost to say anything about its prior."""
    tells: float = 0.01
    """Part of what is known in a direction that a run must tell, so that it may contradict the
    others there: what it says of less moves the estimate by about a tenth of its 1-sigma, and is as
    much the curvature of the model as a reading."""
    most_named: int = 3
    """Numbers of the description that are named: what is named first may explain the rest."""
    fewest_blocks: int = 8
    """Stretches that tell a variance of scores."""
    told: float = 0.5
    """Part of what is known of a number that the motion must have told, and not its noise: the
    scale of a gyro about an axis about which nothing turns was -1 by its noise."""
    its_own: float = 1e-3
    """Least part of a column that no estimated unknown could stand in for; less says nothing about
    this number alone."""
    clipped: float = 0.02
    """Part of the samples of a force sensor at the end of its range, beyond which they count."""
    most_outliers: float = 0.05
    """Part of the samples of a run that may stand out: sound ones have .01 at most."""
    largest_disturbance: Mapping[str, float] = field(
        default_factory=lambda: FIT.largest_disturbance
    )
    """Unit -> rms of a disturbance of an instrument that nobody has stated, beyond which it is an
    error of the description: the same as the linear methods do not take up."""
    against: float = 0.8
    """Correlation of what is read with minus what the motion has, from which on a reading has the
    wrong sign: of noise beside a motion it is positive."""
    seen_above_noise: float = 5.0
    """Root mean square of such a reading, in its 1-sigma, at least."""
    fewest_readings: int = 100
    """Readings that tell it, at least."""
    largest_wrench: float = 0.1
    """The same of an unmodelled wrench, as a part of the weight: by the platform's size of
    torques."""
    largest_pull: float = 0.5
    """The same of what moves in a load: a third of the mass on a string near its resonance pulls
    with a third of the weight."""
    set_by: float = 0.005
    """Change of a delay within a run [s] that is no wandering of clocks, so that it counts also
    where the estimate does not seem to move with it: the fit has settled between before and after
    then."""
    slipped_by: float = 0.02
    """The same of an instrument against others of its clock: samples that a logger has lost shift
    it by whole ones, and friction in rollers looks like a latency that changes by some
    milliseconds."""
    on_both_sides: float = 2.0
    """Least time [s] before and after such a change: while a motion begins, what is not settled yet
    looks like a delay."""
    surely_late: float = 3.0
    """1-sigma by which an instrument is later than is stated of it."""
    largest_torque: float = 0.25
    """The same of an unmodelled torque, as a part of that which turns the body: by how much of it
    follows the motion by chance, some per cent of the moments are not told."""
    short: float = 12.0
    """Length of a motion [s] below which a load that swings is not told from what pulls by itself:
    it takes some periods of a string of a metre or two."""
    largest_force: float = 0.04
    """An unmodelled force in a shorter one, as a part of that which accelerates the body."""
    mostly_left_out: float = 0.5
    """Part of swings without force sensors that is left out, beyond which longer ones are no
    help."""
    many_contacts: int = 3
    """Contacts from which what goes on between them is compared with them."""
    contacts_stand_out: float = 0.15
    """Part of the force of contacts that an unmodelled one between them may be: hands and obstacles
    stand out of all else."""
    biased: float = 2.0
    """A bias by noise in the regressor of so many 1-sigma is no longer small, so that a correction
    of first order need not be enough."""
    factor_of_mass: float = 4.0
    """A mass so many times more or less than the nominal one is a matter of units rather than of
    load."""

    # Mistakes that are named where nothing balances

    swap_samples: int = 400
    """At which exchanged columns are tried."""
    swap_offset: float = 0.01
    """1-sigma of the offsets of force sensors there, as a part of the median tension."""
    swap_better: float = 0.25
    """Part of the residual that an exchange must leave at most to be named."""
    near: float = 0.15
    """How near a ratio of gravity must be to that of a mistake."""


VERDICT = VerdictSettings()
"""What is used where nothing is given."""
