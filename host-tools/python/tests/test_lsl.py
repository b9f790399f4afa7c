"""The outlets against LSL's own reader on this computer, and `Device.record`, which feeds them."""

import json

import numpy as np
import pytest
import stylus_haptics as sh

from conftest import ANSWER_S
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
    (found,) = pylsl.resolve_byprop("name", name, 1, 5)
    reader = pylsl.StreamInlet(found)
    reader.open_stream(5)
    return reader


def counted(outlets) -> list[int]:
    """The first tick of each block that `outlets` will have heard."""
    ticks, taken = [], outlets.heard
    outlets.heard = lambda tick, samples: (ticks.append(tick), taken(tick, samples))
    return ticks


def pulled(reader, count: int) -> tuple[np.ndarray, np.ndarray]:
    """`count` samples. They come in the end, however busy this computer is."""
    samples, stamps = [], []
    while sum(map(len, stamps)) < count:
        most = count - sum(map(len, stamps))
        chunk, times = reader.pull_chunk(timeout=ANSWER_S, max_samples=most, min_samples=1, as_numpy=True)
        assert len(times) > 0, "nothing more arrives"
        samples.append(chunk)
        stamps.append(times)
    return np.concatenate(samples), np.concatenate(stamps)


@needs_lsl
def test_a_reader_of_lsl_sees_samples_at_their_true_times_to_within_a_millisecond():
    simulated = Simulated(3, 100.0, resets=1)
    simulated.slow = []
    device = SimulatedDevice(simulated)
    outlets = Outlets(device, name="loopback")
    outlets._now = device.now
    blocks = counted(outlets)
    readers = {part: inlet(f"loopback-{part}") for part in ("acceleration", "motion", "output")}
    for _ in simulated.lives:
        device.restart()
        outlets.follow(device)
        # The device's clock differs by 50 ppm, and the temperature's part.
        assert 45 < abs(outlets.clock.drift_ppm) < 55
    samples, stamps = pulled(readers["acceleration"], BLOCK * len(blocks))
    assert len(samples) > 300_000
    for number, life in enumerate(simulated.lives):
        of_life = samples[:, 2] == number
        ticks = 4096 * samples[of_life, 0].astype(np.int64) + samples[of_life, 1].astype(np.int64)
        errors = stamps[of_life] - OFFSET_S - simulated.true_s(life, ticks)
        assert np.abs(errors).max() < 1e-3
        assert (np.diff(ticks) > 0).all() and (np.diff(stamps[of_life]) > 0).all()
    motions, of_motions = pulled(readers["motion"], BLOCK * len(blocks))
    assert np.array_equal(of_motions, stamps)
    assert np.allclose(motions, [120, 1], rtol=1e-5)
    expected = [{**OUTPUT, "muted": muted} for muted in (["not playing"], [])] * len(simulated.lives)
    marks, _ = readers["output"].pull_chunk(timeout=ANSWER_S, max_samples=len(expected))
    assert [json.loads(mark) for (mark,) in marks] == expected


@needs_lsl
def test_a_readers_clock_is_the_outlets_and_the_description_has_units_labels_and_provenance():
    outlets = Outlets(SimulatedDevice(Simulated(0, 20.0, resets=0)), name="described")
    reader = inlet("described-motion")
    assert abs(reader.time_correction(5)) < 1e-3
    info = reader.info()
    assert (info.nominal_srate(), info.channel_count(), info.source_id()) == (5000, 2, "stylus-LOOPBACK-motion")
    assert info.get_channel_labels() == ["speed", "force"] and info.get_channel_units() == ["mm/s", "N"]
    acquisition = info.desc().child("acquisition")
    assert acquisition.child_value("serial_number") == "LOOPBACK"
    assert acquisition.child_value("provenance") == "SIMULATED"
    del outlets


@needs_lsl
@pytest.mark.filterwarnings("ignore:the link is slow or busy")
def test_what_a_stylus_records_comes_out_block_by_block(stylus):
    """How true the times are is tested above, in virtual time: a busy computer may hold up the fake stylus's clock."""
    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        outlets = Outlets(device, name="followed")
        blocks = counted(outlets)
        readers = {part: inlet(f"followed-{part}") for part in ("acceleration", "motion")}
        loss = outlets.follow(device, seconds=2)
        assert device.status()["status"]["record"]["recording"] is False
    # Some blocks arrive after the last one that was heard.
    assert 0 < len(blocks) <= loss["received"]
    samples, stamps = pulled(readers["acceleration"], BLOCK * len(blocks))
    assert samples.shape == (BLOCK * len(blocks), 3) and (np.diff(stamps) > 0).all()
    motions, _ = pulled(readers["motion"], BLOCK * len(blocks))
    # The hand of the fake stylus. The speed is a mean over the samples before.
    assert np.allclose(motions[500:], [120, 1], rtol=0.05)


def test_a_recording_that_a_program_fails_in_is_stopped(stylus):
    def heard(first_tick, samples):
        assert samples.shape == (32, 5) and samples.dtype == np.float64
        raise LookupError("a fault of the program")

    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        assert device.is_emulated
        with pytest.raises(LookupError):
            device.record(heard, lambda status, asked_s: None)
        assert device.status()["status"]["record"]["recording"] is False
