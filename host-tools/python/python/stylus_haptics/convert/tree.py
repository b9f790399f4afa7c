"""What a file of arrays holds: groups, arrays whose samples are read when they are asked for, and facts about them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any, Callable, Iterator, Optional, Union

import numpy as np

#: Largest size of a file, of what it unpacks to, and of an array in it, bytes.
MOST_BYTES = 1 << 30

#: Most groups, arrays and facts of a file; most levels of groups; most lines of a tree that are shown.
MOST_PARTS, MOST_LEVELS, MOST_LINES = 100_000, 24, 200

Fact = Union[float, str]


class Refusal(ValueError):
    """What cannot be converted, and the remedy, in words."""


@dataclass(eq=False)
class Array:
    """Samples of a file. ``read`` takes an index of NumPy; ``is_index`` marks the index of a frame of pandas."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    read: Callable[[Any], np.ndarray]
    facts: dict[str, Fact] = field(default_factory=dict)
    is_index: bool = False

    @classmethod
    def of(cls, name: str, values: np.ndarray, facts: Optional[dict[str, Fact]] = None) -> Array:
        """The array of ``values`` in memory."""
        return cls(name, values.shape, values.dtype, values.__getitem__, facts or {})

    @property
    def size(self) -> int:
        """Number of samples."""
        return math.prod(self.shape)

    @property
    def is_vector(self) -> bool:
        """True if all dimensions but one have a size of 1."""
        return max(self.shape, default=0) == self.size


@dataclass
class Group:
    """Arrays and groups. The children of a list are alike, and their names are their numbers, from 1."""

    name: str
    children: list[Union[Array, Group]] = field(default_factory=list)
    facts: dict[str, Fact] = field(default_factory=dict)
    is_list: bool = False

    def path_of(self, name: str, path: str) -> str:
        """The path of a child of this group, which is at ``path``."""
        return f"{path}({name})" if self.is_list else f"{path}/{name}" if path else name


def shown(text: object, most: int = 80) -> str:
    """``text`` as a terminal may show it: names in files may hold any character."""
    plain = "".join(sign if sign.isprintable() else "?" for sign in str(text))
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def size_of(array: Array) -> str:
    """Shape and kind of an array, in words."""
    return " x ".join(map(str, array.shape)) + f" {array.dtype}"


def lines(group: Group) -> list[str]:
    """The tree below ``group``, a line for each array and fact."""
    found = list(_lines(group, "  "))
    more = len(found) - MOST_LINES
    return found if more <= 0 else [*found[:MOST_LINES], f"  ... {more} more"]


def _lines(group: Group, indent: str) -> Iterator[str]:
    for name, fact in group.facts.items():
        yield f"{indent}{shown(name)} = {shown(fact)}"
    for child in group.children:
        if isinstance(child, Group):
            yield f"{indent}{shown(child.name)}/"
            yield from _lines(child, indent + "  ")
        else:
            facts = sorted(child.facts.items(), key=lambda own: not re.search("unit|rate|increment", own[0], re.I))
            told = ", ".join(f"{shown(name)} = {shown(fact, 30)}" for name, fact in facts[:5])
            yield f"{indent}{shown(child.name)}: {size_of(child)}" + (f" ({told})" if told else "")
