"""The stylus's clock on a computer's: from ticks to times, without a device and without LSL.

A computer sees the device's ticks late, by delays that vary, and never early. So each arrival is an upper bound of the
time of its tick, and each question whose answer has a tick is a lower bound of that tick's time. The clocks differ by
their offset and by a rate of some 10⁻⁵ that changes slowly. The map is a straight line under all arrivals of the last
minute, an edge of their lower convex hull (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network
delay measurements", INFOCOM 1999): the one that most of the minute's seconds come near to. A distance above NEAR_S
counts no more than that, because seconds in which everything is late say nothing of the rate.

The line is late by the least delay of the link. Lower bounds tell how much that can be, and the map is in the middle of
what is left. A line that is below a lower bound is wrong: the device's clock has jumped, as it does with a reset. All
but the rate is then forgotten.
"""

from __future__ import annotations

import math

TICK_S = 1 / 5000

# Duration of what the map is made of, s, and of one bin, which keeps its tightest bounds.
WINDOW_S = 64.0
BIN_S = 1.0

# Largest difference of two clocks' rates: two crystals, each with some reserve.
MOST_DRIFT = 150e-6

# Distance above the line within which the earliest arrival of a second is near it, s.
NEAR_S = 0.2e-3

# Distance of the line below a lower bound from which on the clock has jumped, s. Less than that is the grain of the
# ticks: an emulated stylus runs several at a time.
TOLERANCE_S = 2e-3


class ClockMap:
    """Times of ticks on this computer's clock, from arrivals and from answers to questions.

    Ticks are 200 µs long by the device's clock. Times are in s, by one clock of this computer that does not jump.
    """

    def __init__(self) -> None:
        #: Number of jumps of the device's clock that nobody announced.
        self.jumps = 0
        self._slope = 0.0
        self.restart()

    def restart(self) -> None:
        """Forgets all but the rate, because the device's clock has begun anew."""
        self._origin: tuple[int, float] | None = None
        # By number of the bin: the place of its tightest bound, s by the device's clock, and the bound without it.
        self._late: dict[int, tuple[float, float]] = {}
        self._early: dict[int, tuple[float, float]] = {}
        self._height = math.inf
        self._room_s = math.inf
        self._extrapolated_s = 0.0

    @property
    def uncertainty_s(self) -> float:
        """Largest error, s, while the rate is steady: half the distance of the bounds, and what the rate may be
        off since the last second that was near the line. Infinite before the first answer."""
        return abs(self._room_s) / 2 + self._extrapolated_s

    @property
    def drift_ppm(self) -> float:
        """Rate of this computer's clock against the device's, less one, in 10⁻⁶."""
        return 1e6 * self._slope

    def arrived(self, tick: int, at_s: float) -> None:
        """Takes in that what was read at `tick` arrived at `at_s`."""
        place, height = self._shifted(tick, at_s)
        number = math.floor(place / BIN_S)
        bound = self._late.get(number)
        is_new = bound is None
        if bound is None or height - bound[1] < self._slope * (place - bound[0]):
            self._late[number] = (place, height)
            if is_new or height < self._at(place):
                self._fit(place)

    def answered(self, tick: int, asked_s: float, at_s: float) -> None:
        """Takes in that `tick` was the device's between the question at `asked_s` and the arrival of the answer."""
        self.arrived(tick, at_s)
        place, height = self._shifted(tick, asked_s)
        if height - self._at(place) > TOLERANCE_S:
            self.jumps += 1
            self.restart()
            self.arrived(tick, at_s)
            place, height = self._shifted(tick, asked_s)
        number = math.floor(place / BIN_S)
        bound = self._early.get(number)
        if bound is None or height - bound[1] > self._slope * (place - bound[0]):
            self._early[number] = (place, height)
            self._bound()

    def time_s(self, tick: int) -> float:
        """The time of `tick`, s. Without any answer yet it is late by the link's least delay."""
        if self._origin is None:
            raise ValueError("no tick has arrived yet: there is no map")
        place = (tick - self._origin[0]) * TICK_S
        delay = self._room_s / 2 if self._room_s < math.inf else 0.0
        return self._origin[1] + place + self._at(place) - delay

    def _shifted(self, tick: int, at_s: float) -> tuple[float, float]:
        """Place of the tick, s by the device's clock, and how much later than by that clock `at_s` is."""
        if self._origin is None:
            self._origin = (tick, at_s)
        place = (tick - self._origin[0]) * TICK_S
        return place, at_s - self._origin[1] - place

    def _at(self, place: float) -> float:
        return self._height + self._slope * place

    def _fit(self, newest: float) -> None:
        """Finds the line under all late bounds, and its room above the early ones."""
        for bounds in (self._late, self._early):
            for number in [n for n in bounds if (n + 1) * BIN_S < newest - WINDOW_S]:
                del bounds[number]
        late = sorted(self._late.values())
        # The rate so far counts as well as another that makes the sum smaller by no more than one second's part.
        slopes = [self._slope, *(min(MOST_DRIFT, max(-MOST_DRIFT, slope)) for slope in _slopes_of_hull(late))]
        sums = [_distances(late, slope) for slope in slopes]
        best = min(range(len(slopes)), key=lambda n: sums[n] - NEAR_S * (n == 0))
        self._slope = slopes[best]
        self._height = min(height - self._slope * place for place, height in late)
        near = [place for place, height in late if height - self._at(place) < NEAR_S]
        rate_off = min(MOST_DRIFT, NEAR_S / 2 / max(near[-1] - near[0], BIN_S))
        self._extrapolated_s = rate_off * max(0.0, newest - near[-1] - BIN_S)
        self._bound()

    def _bound(self) -> None:
        """Finds the room between the line and the lower bounds."""
        room = min((self._at(place) - height for place, height in self._early.values()), default=math.inf)
        self._room_s = room
        if room < -TOLERANCE_S:
            # What arrived is before what was asked for: the clock has jumped to earlier times.
            last, origin = max(self._late.values()), self._origin
            self.jumps += 1
            self.restart()
            self._origin, self._late[math.floor(last[0] / BIN_S)], self._height = origin, last, last[1]
            self._height -= self._slope * last[0]


def _distances(points: list[tuple[float, float]], slope: float) -> float:
    """Sum of the distances of `points` from the highest line of that slope under them, each at most NEAR_S."""
    heights = [y - slope * x for x, y in points]
    lowest = min(heights)
    return sum(min(height - lowest, NEAR_S) for height in heights)


def _slopes_of_hull(points: list[tuple[float, float]]) -> list[float]:
    """Slopes of the lower convex hull's edges; `points` are sorted by their first number."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1 and (hull[-1][1] - hull[-2][1]) * (x - hull[-2][0]) >= (y - hull[-2][1]) * (
            hull[-1][0] - hull[-2][0]
        ):
            hull.pop()
        hull.append((x, y))
    return [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in zip(hull, hull[1:])]
