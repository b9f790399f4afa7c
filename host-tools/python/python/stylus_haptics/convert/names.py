"""Names of columns and texts of units: the part of the command's rules that a choice needs. Units are written into
names as they are, where the command reads them by all of its rules."""

from __future__ import annotations

import re
from typing import Optional

#: Standard gravity, m/s².
GRAVITY_M_S2 = 9.80665

_GRAVITIES = {"g": 1.0, "gs": 1.0, "gn": 1.0, "g0": 1.0, "mg": 1e-3, "mgs": 1e-3, "ug": 1e-6}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}

#: Units of other quantities, in lower case.
_OTHERS = set(
    "n mn kn kg m cm mm um nm m/s cm/s mm/s um/s nm/s rad/s deg/s °/s dps deg rad ° °c degc pa kpa bar ut gauss t "
    "a ma s ms us ns sec hz db % nmm".split()
)
_OTHER_WORDS = set(
    "force torque gyro gyroscope temperature temp pressure speed velocity position variance covariance std".split()
)
_TIMES = ("timestamps", "timestamp", "times", "time", "stamp", "elapsed", "zeit", "ts", "t")

#: Units of times, as columns are named, by their words.
TIME_UNITS = {
    word: unit
    for unit, words in {
        "s": "s sec secs second seconds",
        "ms": "ms msec millis millisecond milliseconds",
        "us": "us µs μs usec micros microsecond microseconds",
        "ns": "ns nsec nanos nanosecond nanoseconds",
    }.items()
    for word in words.split()
}

#: Facts that tell a rate, an interval in s, a unit or a texture, in lower case without signs.
RATE = re.compile(r"fs|sr|s?rate|fsamp|.*(sample|sampling)(rate|freq|frequency)")
INTERVALS = {"dt", "deltat", "wfincrement", "sampleinterval", "samplinginterval", "sampleperiod", "samplingperiod"}
UNITS = {"unit", "units", "unitstring", "niunitdescription"}
TEXTURES = {"texture", "material", "surface"}


def words(name: str) -> list[str]:
    """The words of a name, in lower case."""
    return [word for word in re.split(r"[\W_]+", name.lower()) if word]


def bare(name: str) -> str:
    """A name in lower case, without signs."""
    return "".join(words(name))


def m_s2(unit: str) -> Optional[float]:
    """A unit of acceleration in m/s², such as ``mg``, ``m/s^2`` or ``g/256``; None for another unit."""
    divided = re.fullmatch(r"(.+)/ *(\d+(?:\.\d+)?) *", unit)
    if divided:
        own = m_s2(divided[1])
        return own / float(divided[2]) if own and float(divided[2]) else None
    plain = unit.lower().translate(str.maketrans("²⁻−µμ", "2--uu")).replace("per", "/").replace("sec", "s")
    plain = re.sub(r"[ _^*·⋅.()']", "", plain)
    length = re.fullmatch(r"(.*?)(/s2|s-2|ps2|s2|/s/s)", plain)
    return _LENGTHS.get(length[1]) if length else _GRAVITIES.get(plain, 0) * GRAVITY_M_S2 or None


def unit_in(name: str) -> Optional[str]:
    """The unit in a name: in brackets, or one of acceleration or of another quantity as its last words."""
    inside = re.findall(r"[\[(]([^\[\]()]+)[\])]", name)
    ends = [name[match.end() :] for match in re.finditer(r"[ _\-,:/.;]", name)]
    return str(inside[-1]) if inside else next((end for end in ends if m_s2(end) or end.lower() in _OTHERS), None)


def time_unit(name: str) -> Optional[str]:
    """The unit of a column of times by its name, empty if that tells none; None if it is no column of times."""
    unit, is_time = "", False
    for word in words(name):
        rests = [TIME_UNITS.get(word[len(time) :]) for time in _TIMES if word.startswith(time)]
        joined = next(filter(None, rests), None)
        if word not in _TIMES and word not in TIME_UNITS and not joined:
            return None
        # A single letter may mean anything.
        is_time |= word in _TIMES or bool(joined) or len(word) > 1
        unit = unit if word in _TIMES else TIME_UNITS.get(word) or joined or ""
    return unit if is_time else None


def rank(name: str, unit: Optional[str]) -> int:
    """2 for a name or a unit of acceleration, 1 for the letter of an axis alone, 0 for others, -1 for what is none."""
    own = words(name)
    if unit and m_s2(unit):
        return 2
    if (unit or "").strip().lower() in _OTHERS or _OTHER_WORDS & set(own):
        return -1
    is_meant = any(re.fullmatch(r"acc|accel.*|beschleunigung.*|(acc|gf|a)[xyz]", word) for word in own)
    return 2 if is_meant or re.match(r"a[\W_]+[xyz]\b", name.lower()) else int(own[:1] in (["x"], ["y"], ["z"]))


def is_magnitude(name: str) -> bool:
    """True for the magnitude of all axes."""
    return bool({"absolute", "abs", "magnitude", "norm", "total"} & set(words(name)))
