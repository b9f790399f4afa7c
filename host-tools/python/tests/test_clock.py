"""The map of clocks against a simulated device, whose true times are known, over an hour.

The truth is the phase of the device's clock, integrated over true time on a grid of 10 ms and inverted by
interpolation: nothing of the map's own model is in it.
"""

import numpy as np
import pytest
from stylus_haptics.clock import ClockMap

BLOCK = 32
GRID_S = 0.01


class Simulated:
    """A device that records, and a link to it: what a computer sees, and what is true."""

    def __init__(self, seed: int, seconds: float, resets: int = 2, jitter_s: float = 3e-3) -> None:
        self.generator = generator = np.random.default_rng(seed)
        self.jitter_s = jitter_s
        self.grid = np.arange(0.0, seconds, GRID_S)
        # 50 ppm fast or slow, with a temperature that changes it by 3 ppm within a quarter of an hour.
        period, shift = generator.uniform(600, 1200), generator.uniform(0, 2 * np.pi)
        drift = generator.choice([-50e-6, 50e-6]) + 3e-6 * np.sin(2 * np.pi * self.grid / period + shift)
        phase = np.concatenate([[0.0], np.cumsum(5000 * (1 + drift[:-1]) * GRID_S)])
        ends = np.sort(generator.uniform(0.1, 0.9, resets)) * seconds
        self.lives = []
        for begin, end in zip([0.0, *(ends + 1.7)], [*ends, seconds]):
            # Ticks count from the start of the device, which was some time before it is seen.
            first = int(generator.integers(0, 10**7))
            self.lives.append((begin, end, phase - np.interp(begin, self.grid, phase) + first, first))
        # Times in which all waits: a computer that is busy, a cable's retries; and others in which all is slower.
        times = lambda every_s: generator.uniform(10, seconds, int(seconds / every_s))
        self.stalls = [(at, at + generator.uniform(0.05, 3)) for at in times(60)]
        self.slow = [(at, at + generator.uniform(5, 20)) for at in times(300)]
        self.least_s = (generator.uniform(0.1e-3, 0.9e-3), generator.uniform(0.1e-3, 0.9e-3))

    def true_s(self, life, ticks):
        return np.interp(ticks, life[2], self.grid)

    def delayed(self, sent_s, way):
        """Times of arrival, first in first out, of what was sent at `sent_s`."""
        at = sent_s + self.least_s[way] + self.generator.exponential(self.jitter_s, len(sent_s))
        for begin, end in self.slow:
            at[(sent_s > begin) & (sent_s < end)] += 8e-3
        for begin, end in self.stalls:
            at[(at > begin) & (at < end)] = end
        return np.maximum.accumulate(at)

    def events(self, life):
        """Arrivals of blocks (at, tick, nan) and of answers (at, tick, asked) of one life, in their order."""
        begin, end, phase, first = life
        last = int(np.interp(end, self.grid, phase))
        ticks = np.arange(first + BLOCK - 1, last, BLOCK)
        kept = np.ones(len(ticks), bool)
        for at in self.generator.integers(0, len(ticks), 1 + len(ticks) // 30_000):
            kept[at : at + self.generator.integers(1, 2000)] = False
        # A burst of questions before the first block, and four per second from then on.
        asked = np.concatenate([begin + 0.02 * np.arange(16), np.arange(begin + 0.4, end - 1, 0.25)])
        there = self.delayed(asked, 0)
        answers = np.floor(np.interp(there, self.grid, phase)).astype(int)
        blocks = ticks[kept]
        rows = np.concatenate([
            np.column_stack([self.delayed(self.true_s(life, blocks), 1), blocks, np.full(len(blocks), np.nan)]),
            np.column_stack([self.delayed(there, 1), answers, asked]),
        ])
        return rows[np.argsort(rows[:, 0], kind="stable")]


def mapped(events, true_s, clock: ClockMap, offset_s: float = 1e5) -> np.ndarray:
    """Per block at its arrival: that time, error of the map and its uncertainty, s. `true_s` is that of each event."""
    rows = []
    for (at, tick, asked), true in zip(events.tolist(), true_s.tolist()):
        if asked == asked:
            clock.answered(int(tick), asked + offset_s, at + offset_s)
        else:
            clock.arrived(int(tick), at + offset_s)
            rows.append((at, clock.time_s(int(tick)) - offset_s - true, clock.uncertainty_s))
    return np.array(rows)


def mapped_lives(simulated: Simulated) -> np.ndarray:
    clock = ClockMap()
    parts = []
    for life in simulated.lives:
        clock.restart()
        events = simulated.events(life)
        parts.append(mapped(events, simulated.true_s(life, events[:, 1]), clock))
    assert clock.jumps == 0
    return np.concatenate(parts)


def assert_within_a_millisecond(rows: np.ndarray) -> None:
    """Where the map says that it is settled, which is nearly always."""
    _, error, uncertainty = rows.T
    settled = uncertainty < 1e-3
    assert settled.mean() > 0.9
    assert np.abs(error[settled]).max() < 1e-3
    # And where it is not, it says by how much it may be off; a rate that changes adds a little.
    known = np.isfinite(uncertainty)
    assert (np.abs(error) < uncertainty + 0.15e-3)[known].all()


def test_an_hour_with_drift_resets_losses_and_queues_is_mapped_to_within_a_millisecond():
    rows = mapped_lives(Simulated(0, 3600.0))
    assert len(rows) > 500_000
    assert_within_a_millisecond(rows)


@pytest.mark.parametrize("seed", range(1, 13))
def test_whatever_the_delays_the_map_is_within_a_millisecond_and_knows_its_uncertainty(seed):
    assert_within_a_millisecond(mapped_lives(Simulated(seed, 400.0)))


def test_a_tick_that_is_taken_for_its_arrival_is_off_by_far_more():
    simulated = Simulated(0, 400.0, resets=0)
    (life,) = simulated.lives
    blocks = simulated.events(life)
    blocks = blocks[np.isnan(blocks[:, 2])]
    late = blocks[:, 0] - simulated.true_s(life, blocks[:, 1])
    assert late.max() > 20e-3 and np.median(late) > 2e-3


@pytest.mark.parametrize("jump_s", [-20.0, -0.3, -5e-3, 5e-3, 0.3, 20.0])
def test_a_jump_that_nobody_announces_is_found_and_forgotten_within_two_seconds(jump_s):
    simulated = Simulated(5, 200.0, resets=0)
    (life,) = simulated.lives
    events = simulated.events(life)
    true_s = simulated.true_s(life, events[:, 1])
    events[true_s > 120, 1] += round(jump_s * 5000)
    clock = ClockMap()
    at, error, uncertainty = mapped(events, true_s, clock).T
    assert clock.jumps == 1
    judged = (uncertainty < 1e-3) & ((at < 120) | (at > 122))
    assert np.abs(error[judged]).max() < 1e-3
    assert (at[judged] > 122).sum() > 5000
