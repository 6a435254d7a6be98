"""The words by which people call their columns, and what a single name says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from steelyard.units import FACTORS


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _meanings(meanings: dict[str, str]) -> dict[str, str]:
    """Word -> what it means, of what is meant -> its words."""
    return {word: meaning for meaning, words in meanings.items() for word in words.split()}


QUANTITIES: dict[str, frozenset[str]] = {
    "angular_velocity": _words(
        "gyro gyr gyroscope omega w drehrate angvel angularvelocity winkelgeschwindigkeit"
    ),
    "specific_force": _words("a acc accel acceleration accelerometer linacc accl beschleunigung"),
    "orientation": _words(
        "q quat quaternion orientation rotation rot attitude att rpy euler lage dcm"
    ),
    "torque": _words("t tau torque moment mom m drehmoment momente"),
    "force": _words("f force forces kraft kraefte"),
    "position": _words(
        "pos position p prism prisma point translation target tcp xyz location coordinate coord"
        " coordinates koordinate ort marker"
    ),
}
"""Vector or rotation -> words that mean it."""
TENSIONS = _words(
    "f force forces tension tensions tens kraft kraefte seilkraft seilkraefte load loads loadcell"
    " cell effort lc strain"
)
LENGTHS = _words(
    "l len length lengths laenge laengen seillaenge pos position encoder enc q joint paidout"
    " unwound"
)
COMMANDS = _words(
    "cmd command commanded commands ref reference des desired setpoint setpoints set soll sollwert"
    " sollwerte goal demand demanded planned plan"
)
TRACKERS = _words("tracker leica vicon optitrack mocap laser lasertracker prism")
"""Words of file names that mean positions."""
TIMES = _words("t time timestamp timestamps stamp zeit zeitstempel clock datetime date utc")
_TIME_UNITS = _meanings(
    {
        "s": "s sec secs second seconds",
        "ms": "ms msec millis milliseconds",
        "us": "us usec micros microseconds",
        "ns": "ns nsec nanos nanoseconds",
    }
)
IGNORED = _words(
    "mag magnetic magnetometer magnetfeld temp temperature current voltage jerk covariance cov"
    " variance std sigma error err status seq sequence id frame child twist linear jounce snap gps"
    " lat lon power battery"
)
"""Words of columns that no instrument of ours has."""
_SPEEDS = _words("velocity vel speed rate rates")
_ANGULAR = _words("angular ang rot rotational turn gyro omega roll pitch yaw body")
NEUTRAL = _words("vector data msg value values field header pose transform linear raw in of the si")
"""Words that say nothing of whose a column is."""
ANGLES = _meanings({"roll": "roll phi", "pitch": "pitch theta", "yaw": "yaw psi"})
"""Words of the angles -> column of the contract."""
INSTRUMENTS = _words(
    "imu imus accel acc accelerometer gyro gyr wrench fts ft ati force forces kraft cables cable"
    " seile tension tensions tracker leica vicon optitrack mocap laser lasertracker position"
    " positions pos pose poses orientation orientations attitude command cmd commands ref setpoint"
    " setpoints soll length lengths winch winches encoder encoders joint joints states state"
    " loadcell loadcells sensor sensors log data recording xsens mti"
)
"""Words of file names that say which instrument, not which run."""

_ENDINGS = {
    "deg/s": "deg s, deg per s, deg sec, degs, dps",
    "rad/s": "rad s, rad per s, rad sec, rads, rps",
    "m/s^2": "m s 2, m per s 2, mps 2, ms 2, mss",
    "kN": "k n, kn",
    "mN": "m n",
    "daN": "da n, dan",
    "N": "n",
    "kgf": "kgf, kg",
    "lbf": "lbf",
    "N m": "n m, nm",
    "N mm": "nmm",
    "g": "g",
    "mg": "mg",
    "m": "m",
    "cm": "cm",
    "mm": "mm",
    "deg": "deg, degree, degrees",
    "rad": "rad, radians",
}
"""Unit -> how it is written behind a name, in words."""
_UNIT_ENDINGS: dict[tuple[str, ...], str] = {
    tuple(ending.split()): unit for unit, text in _ENDINGS.items() for ending in text.split(", ")
}
_UNIT_ENDINGS.update({(word,): unit for word, unit in _TIME_UNITS.items()})

_COMPACT = re.compile(
    r"(?P<base>w|a|f|t|m|q|p|r|g|acc|accel|gyr|gyro|omega|pos|quat|force|torque|tau|mom|rot|cmd|ref"
    r"|des)(?P<axis>[xyzw])"
)
# fmt: off
_SHARP = str.maketrans({
    "ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "ae", "Ö": "oe", "Ü": "ue",
    "ω": "omega", "φ": "phi", "θ": "theta", "ψ": "psi", "τ": "tau",
})
# fmt: on
_LONGEST = 200
"""Characters of a name that are looked at."""
_MOST_NUMBERS = 4
"""Numbers in a name that may count cables or components."""


@dataclass(frozen=True)
class Name:
    """What the name of a column says."""

    column: str
    words: tuple[str, ...]
    """Letters and numbers of the name in lower case; a component and its vector are two."""
    unit: str | None = None
    """Where the name ends with one."""

    def template(self, place: int) -> tuple[str, ...]:
        """The words with a hole where the component stands: those of one vector share it."""
        return (*self.words[:place], "@", *self.words[place + 1 :])

    @property
    def axis(self) -> int | None:
        """Where x, y, z or w stands; None: nowhere."""
        places = [i for i, word in enumerate(self.words) if word in {"x", "y", "z", "w"}]
        return places[-1] if places else None

    @property
    def angle(self) -> int | None:
        """Where roll, pitch or yaw stands."""
        return next((i for i, word in enumerate(self.words) if word in ANGLES), None)

    @property
    def numbers(self) -> list[int]:
        """Where numbers stand, the last few."""
        places = [i for i, word in enumerate(self.words) if word.isdigit() and len(word) < 5]
        return places[-_MOST_NUMBERS:]

    @property
    def is_time(self) -> bool:
        """Whether it names instants."""
        if len(self.words) == 1 and self.words[0] in _TIME_UNITS:
            return True
        return bool(self.words) and self.words[-1] in TIMES


def read_name(column: str) -> Name:
    """Words, component and unit of the name of a column."""
    words = words_of(column)
    for length in (4, 3, 2, 1):
        ending = _UNIT_ENDINGS.get(words[-length:]) if len(words) > length else None
        rest = Name(column, _components(words[:-length]), ending)
        if ending and _may_have_unit(rest, ending):
            return rest
    if len(words) == 1 and words[0] in _TIME_UNITS:
        return Name(column, words, _TIME_UNITS[words[0]])
    return Name(column, _components(words))


def words_of(text: str) -> tuple[str, ...]:
    """Letters and numbers of a text in lower case: ``/imu/accX_1`` is imu, acc, x, 1."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text[:_LONGEST].translate(_SHARP))
    return tuple(re.findall(r"[a-z]+|\d+", text.lower()))


def _components(words: tuple[str, ...]) -> tuple[str, ...]:
    """Words with components as words of their own: wx is w, x."""
    parts: list[str] = []
    for word in words:
        match = _COMPACT.fullmatch(word)
        parts += [match["base"], match["axis"]] if match else [word]
    return tuple(parts)


def _may_have_unit(name: Name, unit: str) -> bool:
    """Whether what is left of a name may have a unit."""
    if unit in FACTORS["s"]:
        return name.is_time
    return name.axis is not None or name.angle is not None or bool(name.numbers)


def quantity_of(words: tuple[str, ...]) -> str | None:
    """Which vector or rotation words speak of; the last that says anything decides. None: of none
    of ours; "": they do not say.
    """
    known = [word for word in words if word != "@"]
    if _SPEEDS.intersection(known):
        return "angular_velocity" if _ANGULAR.intersection(known) else None
    if "angular" in known or "magnetic" in known:
        return None
    for word in reversed(known):
        if word in {"covariance", "cov", "variance", "std", "mag", "magnetometer", "error"}:
            return None
        for quantity, its in QUANTITIES.items():
            if word in its:
                return quantity
    return None if IGNORED.intersection(known) else ""
