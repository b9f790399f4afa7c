"""What is asked for, and what a recording is within a file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, NamedTuple, Optional

import numpy as np

from . import tree
from .tree import Array, Fact, Group, Refusal, shown, size_of

#: Range of sample rates that the command reads, Hz.
RATES_HZ = (100.0, 768_000.0)


class Asked(NamedTuple):
    """What the user has said; ``signal`` may be a pattern, ``time`` and ``axes`` name or count columns."""

    signal: Optional[str] = None
    time: Optional[str] = None
    rate_hz: Optional[float] = None
    axes: Optional[str] = None
    unit: Optional[str] = None

    @property
    def time_name(self) -> str:
        """The name of the times, without its path."""
        return (self.time or "").rpartition("/")[2]

    def means(self, path: str) -> bool:
        """True if ``signal`` is this path or its end, a pattern that it fits, or not said."""
        own = self.signal
        return own is None or own in (path, path.rpartition("/")[2]) or fnmatchcase(path, own)


class Column(NamedTuple):
    """A vector within an array."""

    name: str
    array: Array
    index: Any = slice(None)

    def values(self) -> np.ndarray:
        """The samples, of the array's own kind."""
        if 8 * self.array.size > tree.MOST_BYTES:
            raise Refusal(f"'{shown(self.name)}' takes more than {tree.MOST_BYTES >> 20} MiB: cut it first")
        return np.asarray(self.array.read(self.index)).reshape(-1)

    def length(self) -> int:
        """Number of samples."""
        whole = not isinstance(self.index, tuple)
        return self.array.size if whole else self.array.shape[self.index.index(slice(None))]

    def rises(self) -> bool:
        """True if each value is above the one before it."""
        return bool((np.diff(self.values()) > 0).all())


class Place(NamedTuple):
    """A group, and which part of a list or an array in it is meant: its number, from 0, of how many."""

    group: Group
    path: str = ""
    above: Optional[Place] = None
    part: Optional[tuple[int, int]] = None


@dataclass
class Signal:
    """One recording, or columns of one length that may be one. ``rate_hz`` is None where ``time`` counts."""

    path: str
    axes: list[Column]
    place: Place
    is_named: bool = True
    rank: int = 0
    time: Optional[Column] = None
    time_unit: str = ""
    rate_hz: Optional[float] = None
    start_s: float = 0.0
    units: list[Optional[str]] = field(default_factory=list)
    trial: dict[str, Fact] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    kind: str = ""
    ask: str = ""

    def key(self) -> str:
        """What trials of one kind have in common: columns named as accelerations, or the path but for numbers."""
        own = ", ".join(axis.name for axis in self.axes)
        return self.kind or re.sub(r"\d+", "#", own if self.rank == 2 else f"{self.path} {own}")

    def told(self) -> str:
        """The signal in words, for a choice."""
        columns = ", ".join(shown(axis.name, 30) for axis in self.axes[:20]) if self.is_named else ""
        return f"'{shown(self.path or '/')}' ({columns or size_of(self.axes[0].array)})"
