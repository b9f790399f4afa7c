"""A stylus on a laboratory's clock: its streams for the Lab Streaming Layer, LSL. Needs ``stylus_haptics[lsl]``.

    >>> import stylus_haptics as sh
    >>> from stylus_haptics.lsl import Outlets
    >>> with sh.Device() as stylus:
    ...     Outlets(stylus).follow(stylus, seconds=600)

Three streams: ``stylus-acceleration`` (x, y and z, m/s²) and ``stylus-motion`` (speed, mm/s, and force, N), both of
5 kHz, and ``stylus-output``, a marker in JSON for each change of what is played or mutes it. The stamps are times of
the converters' samples by LSL's clock on this computer, by ``stylus_haptics.clock``. What was lost on the way is left
out, and what is torn is NaN.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ._native import SAMPLE_RATE_HZ, Device, StylusWarning
from .clock import TICK_S, ClockMap

# Uncertainty from which on stamps are given, s, and the time after which they are given all the same.
SETTLED_S = 1e-3
PATIENCE_S = 5.0

# Questions before a recording begins: the shortest of their round trips bounds the clock's error.
FIRST_QUESTIONS = 16

# The stylus's own speed is the mean over this time.
SPEED_WINDOW = round(0.02 * SAMPLE_RATE_HZ)


class Outlets:
    """LSL's outlets of one stylus: visible from now on, and fed by `follow`.

    They stay the same over several recordings, so that who listens keeps listening when a cable was pulled. `name`
    begins the streams' names. The description of each has units, the serial number, and for an emulated stylus the
    mark SIMULATED.
    """

    def __init__(self, device: Device, *, name: str = "stylus") -> None:
        try:
            import pylsl  # type: ignore[import-untyped, unused-ignore]
        except (ImportError, RuntimeError) as failure:
            raise ImportError(f"LSL is not there ({failure}): pip install 'stylus_haptics[lsl]'") from failure
        serial = str(device.info["serial"])

        def outlet(part: str, kind: str, channels: list[tuple[str, str, str]], rate_hz: int, form: str) -> Any:
            info = pylsl.StreamInfo(f"{name}-{part}", kind, len(channels), rate_hz, form, f"stylus-{serial}-{part}")
            info.set_channel_labels([label for label, _, _ in channels])
            info.set_channel_types([kind for _, kind, _ in channels])
            info.set_channel_units([unit for _, _, unit in channels])
            acquisition = info.desc().append_child("acquisition")
            acquisition.append_child_value("model", "stylus")
            acquisition.append_child_value("serial_number", serial)
            acquisition.append_child_value("provenance", "SIMULATED" if device.is_emulated else "recorded")
            info.desc().append_child("synchronization").append_child_value("can_drop_samples", "true")
            return pylsl.StreamOutlet(info)

        axes = [(axis, "Acceleration", "m/s^2") for axis in "xyz"]
        motion = [("speed", "Speed", "mm/s"), ("force", "Force", "N")]
        self._acceleration = outlet("acceleration", "Accelerometer", axes, SAMPLE_RATE_HZ, "float32")
        self._motion = outlet("motion", "Motion", motion, SAMPLE_RATE_HZ, "float32")
        self._output = outlet("output", "Markers", [("output", "Marker", "json")], 0, "string")
        self._now: Callable[[], float] = pylsl.local_clock
        self._next_tick: int | None = None
        self._first_s: float | None = None
        self._begin()

    @property
    def clock(self) -> ClockMap:
        """The map from the device's ticks to LSL's clock, with its uncertainty."""
        return self._clock

    def follow(self, device: Device, seconds: float | None = None) -> dict[str, Any]:
        """Records with `device` and feeds the outlets, for `seconds` or until Ctrl-C. Returns the losses.

        What another program plays at the same time is told on the output's stream. Raises `StylusError` if the link
        is lost; call it again with a device that was opened anew.
        """
        self._begin()
        for _ in range(FIRST_QUESTIONS):
            asked = self._now()
            self._answered(device.status(), asked)
        end = None if seconds is None else self._now() + seconds

        def heard(first_tick: int, samples: npt.NDArray[np.float64]) -> bool:
            self.heard(first_tick, samples)
            return end is not None and self._now() >= end

        try:
            return device.record(heard, self.told)
        finally:
            if self._waiting and self._is_settled(np.inf):
                self._publish_all()

    def heard(self, first_tick: int, samples: npt.NDArray[np.float64]) -> None:
        """Takes in a block of `Device.record` that has just arrived, and publishes it once the clock is known."""
        now = self._now()
        if self._next_tick is not None and first_tick < self._next_tick:
            self._begin()
        if self._first_s is None:
            self._first_s = now
        last_tick = first_tick + len(samples) - 1
        self._clock.arrived(last_tick, now)
        if first_tick != self._next_tick:
            self._path = np.zeros(0)
        self._next_tick = last_tick + 1
        path = np.concatenate([self._path, samples[:, 3]])
        self._path = path[-SPEED_WINDOW:]
        sums = np.concatenate([[0.0], np.cumsum(path)])
        ends = np.arange(len(path) - len(samples), len(path)) + 1
        begins = np.maximum(ends - SPEED_WINDOW, 0)
        speed = (sums[ends] - sums[begins]) / ((ends - begins) * TICK_S)
        self._waiting.append((first_tick, samples[:, :3], np.column_stack([speed, samples[:, 4]])))
        if self._is_settled(now - self._first_s):
            self._publish_all()

    def told(self, status: dict[str, Any], asked_s: float) -> None:
        """Takes in a status of `Device.record`, which was asked for `asked_s` ago."""
        self._answered(status, self._now() - asked_s)

    def _begin(self) -> None:
        """A clock that begins anew, and nothing of a recording yet."""
        self._clock = ClockMap()
        self._waiting: list[tuple[int, npt.NDArray[np.float64], npt.NDArray[np.float64]]] = []
        self._path = np.zeros(0)
        self._next_tick = None
        self._first_s = None
        self._stamped_s = -np.inf
        self._marked = ""
        self._has_warned = False

    def _answered(self, status: dict[str, Any], asked_s: float) -> None:
        tick = status["status"]["tick"]["ticks"]
        self._clock.answered(tick, asked_s, self._now())
        output = status["status"]["output"]
        told = {name: output[name] for name in ("activity", "amplifier")}
        mark = json.dumps({**told, "muted": status["muted"]}, ensure_ascii=False)
        if mark != self._marked and self._clock.uncertainty_s < SETTLED_S:
            self._marked = mark
            self._output.push_sample([mark], self._clock.time_s(tick))

    def _publish_all(self) -> None:
        for waited in self._waiting:
            self._publish(*waited)
        self._waiting.clear()

    def _is_settled(self, waited_s: float) -> bool:
        if self._clock.uncertainty_s < SETTLED_S:
            return True
        if waited_s > PATIENCE_S and not self._has_warned:
            self._has_warned = True
            off_ms = 1e3 * self._clock.uncertainty_s
            problem = f"the link is slow or busy: stamps may be off by {off_ms:.1f} ms"
            warnings.warn(problem, StylusWarning, stacklevel=3)
        return self._has_warned

    def _publish(self, first_tick: int, acceleration: npt.NDArray[Any], motion: npt.NDArray[Any]) -> None:
        count = len(acceleration)
        # The map is drawn anew all the time; a later sample never gets an earlier stamp.
        first_s = max(self._clock.time_s(first_tick), self._stamped_s + 1e-6)
        last_s = max(self._clock.time_s(first_tick + count - 1), first_s + 1e-6 * count)
        stamps = np.linspace(first_s, last_s, count)
        self._stamped_s = last_s
        self._acceleration.push_chunk(acceleration.astype(np.float32), stamps)
        self._motion.push_chunk(motion.astype(np.float32), stamps)
