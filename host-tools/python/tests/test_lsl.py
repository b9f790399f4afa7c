"""The outlets against LSL's own reader on this computer, and `Device.record`, which feeds them."""

import json

import numpy as np
import pytest
import stylus_haptics as sh

from test_clock import BLOCK, Simulated

missing = ""
try:
    import pylsl
    from stylus_haptics.lsl import Outlets

    # This computer alone, so that no laboratory's network sees the tests.
    pylsl.set_config_content("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
except (ImportError, RuntimeError) as failure:
    pylsl, missing = None, str(failure)
needs_lsl = pytest.mark.skipif(pylsl is None, reason=f"{missing}: pip install 'stylus_haptics[lsl]'")

OFFSET_S = 1e5
# What only a fault needs.
PATIENCE_S = 300
OUTPUT = {"activity": "Idle", "amplifier": False}


class SimulatedDevice:
    """A device of `Simulated` on a link in virtual time, with what `Outlets` calls. Each sample's acceleration says
    which it is, exactly: the tick is 4096 x + y, and z the number of the device's life."""

    info = {"serial": "LOOPBACK"}
    is_emulated = True

    def __init__(self, simulated: Simulated) -> None:
        self.simulated = simulated
        self.life = -1
        self.now_s = 0.0

    def restart(self) -> None:
        self.life += 1
        self.now_s = self.simulated.lives[self.life][0]

    def now(self) -> float:
        return self.now_s + OFFSET_S

    def status(self) -> dict:
        there = self.simulated.delayed(np.array([self.now_s]), 0)
        tick = np.interp(there, self.simulated.grid, self.simulated.lives[self.life][2])
        (self.now_s,) = self.simulated.delayed(there, 1)
        return {"status": {"tick": {"ticks": int(tick[0])}, "output": OUTPUT}, "muted": ["not playing"]}

    def record(self, heard, told) -> dict:
        for at, tick, asked in self.simulated.events(self.simulated.lives[self.life]).tolist():
            if at < self.now_s:
                continue
            self.now_s = at
            if asked == asked:
                told({"status": {"tick": {"ticks": int(tick)}, "output": OUTPUT}, "muted": []}, at - asked)
            else:
                ticks = int(tick) - BLOCK + 1 + np.arange(BLOCK)
                # 120 mm/s, and 1 N.
                rest = np.tile([self.life, 120 / 5000, 1.0], (BLOCK, 1))
                heard(int(ticks[0]), np.column_stack([ticks // 4096, ticks % 4096, rest]))
        return {}


def inlet(name: str):
    (found,) = pylsl.resolve_byprop("name", name, 1, PATIENCE_S)
    reader = pylsl.StreamInlet(found)
    reader.open_stream(PATIENCE_S)
    return reader


def counted(outlets: "Outlets") -> list[int]:
    """The numbers of samples that are published from now on."""
    counts: list[int] = []
    publish = outlets._publish

    def counting(first_tick, acceleration, motion):
        counts.append(len(acceleration))
        publish(first_tick, acceleration, motion)

    outlets._publish = counting
    return counts


def pulled(reader, count: int) -> tuple[np.ndarray, np.ndarray]:
    """So many samples, and no more has arrived with them."""
    samples, stamps = [], []
    while sum(map(len, stamps)) < count:
        chunk, times = reader.pull_chunk(timeout=PATIENCE_S, max_samples=1 << 22, min_samples=1, as_numpy=True)
        assert len(times) > 0, f"{sum(map(len, stamps))} of {count} samples have arrived"
        samples.append(chunk)
        stamps.append(times)
    assert sum(map(len, stamps)) == count
    return np.concatenate(samples), np.concatenate(stamps)


@needs_lsl
def test_a_reader_of_lsl_sees_samples_at_their_true_times_to_within_a_millisecond():
    simulated = Simulated(3, 100.0, resets=1)
    simulated.slow = []
    device = SimulatedDevice(simulated)
    outlets = Outlets(device, name="loopback")
    outlets._now = device.now
    counts = counted(outlets)
    readers = {part: inlet(f"loopback-{part}") for part in ("acceleration", "motion", "output")}
    for _ in simulated.lives:
        device.restart()
        outlets.follow(device)
        # The device's clock differs by 50 ppm, and the temperature's part.
        assert 45 < abs(outlets.clock.drift_ppm) < 55
    samples, stamps = pulled(readers["acceleration"], sum(counts))
    assert len(samples) > 300_000
    for number, life in enumerate(simulated.lives):
        of_life = samples[:, 2] == number
        ticks = 4096 * samples[of_life, 0].astype(np.int64) + samples[of_life, 1].astype(np.int64)
        errors = stamps[of_life] - OFFSET_S - simulated.true_s(life, ticks)
        assert np.abs(errors).max() < 1e-3
        assert (np.diff(ticks) > 0).all() and (np.diff(stamps[of_life]) > 0).all()
    motions, of_motions = pulled(readers["motion"], sum(counts))
    assert np.array_equal(of_motions, stamps)
    assert np.allclose(motions, [120, 1], rtol=1e-5)
    expected = [{**OUTPUT, "muted": muted} for muted in (["not playing"], [])] * len(simulated.lives)
    marks = [readers["output"].pull_sample(PATIENCE_S)[0] for _ in expected]
    assert [json.loads(mark) for (mark,) in marks] == expected
    assert readers["output"].samples_available() == 0


@needs_lsl
def test_the_stamps_are_by_lsls_clock_and_the_description_has_units_labels_and_provenance():
    outlets = Outlets(SimulatedDevice(Simulated(0, 20.0, resets=0)), name="described")
    reader = inlet("described-motion")
    assert outlets._now is pylsl.local_clock
    info = reader.info(PATIENCE_S)
    assert (info.nominal_srate(), info.channel_count(), info.source_id()) == (5000, 2, "stylus-LOOPBACK-motion")
    assert info.get_channel_labels() == ["speed", "force"] and info.get_channel_units() == ["mm/s", "N"]
    acquisition = info.desc().child("acquisition")
    assert acquisition.child_value("serial_number") == "LOOPBACK"
    assert acquisition.child_value("provenance") == "SIMULATED"
    del outlets


@needs_lsl
def test_a_stylus_that_records_is_followed_in_real_time(stylus):
    with sh.Device(stylus) as device:
        outlets = Outlets(device, name="followed")
        counts = counted(outlets)
        readers = {part: inlet(f"followed-{part}") for part in ("acceleration", "motion")}
        begin = pylsl.local_clock()
        loss = outlets.follow(device, seconds=2)
        end = pylsl.local_clock()
        assert device.status()["status"]["record"]["recording"] is False
    assert loss["received"] > 200
    samples, stamps = pulled(readers["acceleration"], sum(counts))
    # Some blocks arrive after the last one that was heard.
    assert loss["received"] - 100 < len(samples) / 32 <= loss["received"]
    # The fake stylus counts its ticks when a busy computer lets it: to within some milliseconds.
    assert begin - 0.1 < stamps[0] and stamps[-1] < end and (np.diff(stamps) > 0).all()
    assert np.isclose((stamps[-1] - stamps[0]) * 5000, len(stamps) - 1, rtol=0.02)
    motions, _ = pulled(readers["motion"], sum(counts))
    # The hand of the fake stylus.
    assert np.allclose(motions[500:], [120, 1], rtol=0.05)


def test_a_recording_that_a_program_fails_in_is_stopped(stylus):
    def heard(first_tick, samples):
        assert samples.shape == (32, 5) and samples.dtype == np.float64
        raise LookupError("a fault of the program")

    with sh.Device(stylus) as device:
        assert device.is_emulated
        with pytest.raises(LookupError):
            device.record(heard, lambda status, asked_s: None)
        assert device.status()["status"]["record"]["recording"] is False
