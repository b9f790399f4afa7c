"""The player against `render`, and what a control loop and a sound card's callback do with it."""

import contextlib
import runpy
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import pytest
import stylus_haptics as sh

EXAMPLES = Path(__file__).parents[1] / "examples"


def rubbed(player, blocks, motion=lambda _time_s: (130.0, 0.8), samples=10):
    """What `player` at 5 kHz plays along a motion that is told before each block of 2 ms."""
    out = np.empty(blocks * samples, "float32")
    for block in range(blocks):
        player.move(*motion(0.002 * block))
        player.fill(out[block * samples : (block + 1) * samples])
    return out


def test_at_the_textures_rate_it_plays_what_render_plays(fitted):
    player = sh.Player(fitted, "felt", output_rate_hz=5000, seed=7, as_rendered=True)
    expected = sh.render(fitted, "felt", speed_mm_s=130, force_n=0.8, seconds=2, seed=7).samples
    assert np.array_equal(rubbed(player, 1000), expected) and expected.std() > 0.01


def test_the_samples_do_not_depend_on_how_they_are_asked_for(fitted):
    whole, pieces = (sh.Player(fitted, "felt", seed=3) for _ in range(2))
    for player in (whole, pieces):
        player.move(130, 0.8)
    expected = np.empty(960, "float32")
    whole.fill(expected)
    # One channel of two, a column, and single samples.
    stereo, column, single = np.zeros((240, 2), "float32"), np.empty((240, 1), "float32"), np.empty(480, "float32")
    pieces.fill(stereo[:, 1])
    pieces.fill(column)
    for index in range(480):
        pieces.fill(single[index : index + 1])
    assert np.array_equal(np.concatenate([stereo[:, 1], column[:, 0], single]), expected)
    assert not stereo[:, 0].any() and expected.any()
    blocks = sh.Player(fitted, "felt", seed=3)
    blocks.move(130, 0.8)
    found = [block for _, block in zip(range(2), blocks.blocks(480))]
    assert np.array_equal(np.concatenate(found), expected)


def test_positions_play_as_their_speed_and_a_dead_control_loop_becomes_silent(fitted):
    player = sh.Player(fitted, "felt", output_rate_hz=5000)
    block, levels = np.empty(50, "float32"), []
    for step in range(60):
        if step < 30:
            player.move_to(0.01 * step, 1.3 * step, 0.8)
        player.fill(block)
        levels.append(block.std())
    expected = sh.render(fitted, "felt", speed_mm_s=130, force_n=0.8, seconds=5).samples.std()
    assert 0.5 * expected < np.sqrt(np.mean(np.square(levels[5:30]))) < 2 * expected
    assert not any(levels[40:])


def test_a_choice_a_stop_and_a_gain_take_effect_while_it_plays(fitted, tmp_path):
    fitted.save(tmp_path / "a.lib")
    with sh.Player(fitted, "felt", output_rate_hz=5000, as_rendered=True) as player:
        rubbed(player, 20)
        player.choose("cork", library=tmp_path / "a.lib", seed=2)
        player.set_gain(0.5, limit=1000)
        played = rubbed(player, 101)
        fresh = rubbed(sh.Player(fitted, "cork", output_rate_hz=5000, seed=2, as_rendered=True), 100)
        # What sounded fades within a block.
        assert np.array_equal(played[10:], 0.5 * fresh)
        player.set_gain(0.5, limit=1e-3)
        assert np.abs(rubbed(player, 10)).max() == np.float32(1e-3)
    assert not rubbed(player, 20)[50:].any()


def test_a_coil_gets_no_more_than_it_bears_and_nothing_steady(fitted):
    player = sh.Player(fitted, "felt", output_rate_hz=5000)
    player.set_coil(ohms=8, volts_per_m_s2=100, watts=0.1)
    volts = rubbed(player, 5000).astype(float)
    assert 0 < np.abs(volts).max() <= 4 * 0.8**0.5 * 1.000001 and np.mean(volts[-25_000:] ** 2) / 8 <= 0.1
    assert abs(volts[-25_000:].mean()) < 0.01 * volts.std()
    with pytest.raises(sh.StylusError, match="resistance"):
        player.set_coil(8, 0.01, 0)


def test_another_rate_has_the_same_spectrum_below_2_khz(fitted):
    from scipy.signal import welch

    player = sh.Player(fitted, "felt", output_rate_hz=48_000)
    out = np.empty(48_000 * 8, "float32")
    for start in range(0, len(out), 480):
        player.move(130, 0.8)
        player.fill(out[start : start + 480])
    rendered = sh.render(fitted, "felt", speed_mm_s=130, force_n=0.8, seconds=8).samples
    frequency, power = welch(out[4800:], 48_000, nperseg=19_200)
    other, expected = welch(rendered, 5000, nperseg=2000)
    below = frequency <= 2000
    assert np.array_equal(frequency[below], other[: below.sum()])
    assert abs(10 * np.log10(power[below].sum() / expected[: below.sum()].sum())) < 0.1
    assert power[frequency > 3100].sum() < 1e-7 * power.sum()
    assert 0.002 < player.latency_s < 0.0026 and (player.output_rate_hz, player.band_hz) == (48_000, 2000)
    assert sh.Player(fitted, "felt", output_rate_hz=1000).band_hz == 400


def test_a_thread_moves_while_another_fills_and_a_second_filler_is_refused(fitted):
    player = sh.Player(fitted, "felt", output_rate_hz=192_000)
    done = threading.Event()

    def fills():
        out = np.empty(192_000, "float32")
        while not done.is_set():
            # The other thread may be the first.
            with contextlib.suppress(sh.StylusError):
                player.fill(out)

    thread = threading.Thread(target=fills)
    thread.start()
    # The lock of the interpreter is free while samples are made: otherwise no call would ever come during another.
    deadline = time.monotonic() + 300
    with pytest.raises(sh.StylusError, match="make a player for each output"):
        try:
            while time.monotonic() < deadline:
                player.move(100, 0.8)
                player.fill(np.empty(10, "float32"))
        finally:
            done.set()
            thread.join()


@pytest.mark.parametrize(
    ("call", "remedy"),
    [
        (lambda p: p.move(float("nan"), 1), "speed"),
        (lambda p: p.set_gain(float("inf")), "finite gain"),
        (lambda p: p.choose("flet"), "felt"),
        (lambda p: p.choose(), "name a texture or a scene"),
        (lambda p: p.choose("felt", scene="x"), "leave one out"),
        (lambda p: p.fill(np.empty((5, 2), "float32")), r"out\[:, 0\]"),
        (lambda p: p.blocks(0), "1 to 192000"),
    ],
)
def test_what_cannot_be_played_is_refused_with_a_remedy(fitted, call, remedy):
    player = sh.Player(fitted, "felt", output_rate_hz=5000)
    with pytest.raises(sh.StylusError, match=remedy):
        call(player)
    assert rubbed(player, 50).any(), "what plays goes on"


def test_arrays_that_cannot_be_filled_and_rates_that_are_not_played_are_refused(fitted):
    player = sh.Player(fitted, "felt")
    readonly = np.empty(10, "float32")
    readonly.flags.writeable = False
    for out in (np.empty(10), readonly, [0.0] * 10, memoryview(bytearray(40))):
        with pytest.raises(TypeError, match="writable array of float32"):
            player.fill(out)
    with pytest.raises(sh.StylusError, match="multiple of 25 Hz"):
        sh.Player(fitted, "felt", output_rate_hz=44_101)


def test_the_example_of_a_sound_card_fills_its_callback(fitted, tmp_path, monkeypatch):
    """`sounddevice` is a mock here, which calls back as PortAudio does: columns of float32, from another thread."""

    class OutputStream:
        def __init__(self, *, samplerate, channels, dtype, callback, latency, device):
            assert (samplerate, channels, dtype) == (48_000, 1, "float32")
            self.callback, self.played = callback, []

        def __enter__(self):
            self.thread = threading.Thread(target=self.run)
            self.thread.start()
            return self

        def run(self):
            for _ in range(20):
                out = np.zeros((256, 1), "float32")
                self.callback(out, 256, None, "")
                self.played.append(out)

        def __exit__(self, *_exception):
            self.thread.join()

    mock = types.ModuleType("sounddevice")
    mock.OutputStream = OutputStream
    monkeypatch.setitem(sys.modules, "sounddevice", mock)
    monkeypatch.setitem(sys.modules, "tkinter", types.ModuleType("tkinter"))
    example = runpy.run_path(str(EXAMPLES / "sound_card.py"))
    player = sh.Player(fitted, "felt")
    player.move(130, 0.8)
    with example["stream"](player) as played:
        pass
    assert np.concatenate(played.played).any()


def test_the_example_of_a_daq_writes_blocks_within_its_limit(fitted, tmp_path, monkeypatch):
    """`nidaqmx` is a mock here, because its driver is not on this computer. A block takes its time by a clock of the
    test's own."""
    written, now = [], [0.0]

    class Task:
        def __init__(self):
            self.ao_channels = types.SimpleNamespace(add_ao_voltage_chan=lambda *_, **__: None)
            self.timing = types.SimpleNamespace(cfg_samp_clk_timing=lambda *_, **__: None)
            self.out_stream = types.SimpleNamespace()

        def __enter__(self):
            return self

        def __exit__(self, *_exception):
            pass

        def start(self):
            pass

        def write(self, block):
            assert block.dtype == np.float64
            written.append(block)
            now[0] += len(block) / 10_000

    mock, constants = types.ModuleType("nidaqmx"), types.ModuleType("nidaqmx.constants")
    mock.Task, mock.constants = Task, constants
    constants.AcquisitionType = types.SimpleNamespace(CONTINUOUS=1)
    constants.RegenerationMode = types.SimpleNamespace(DONT_ALLOW_REGENERATION=1)
    monkeypatch.setitem(sys.modules, "nidaqmx", mock)
    monkeypatch.setitem(sys.modules, "nidaqmx.constants", constants)
    fitted.save(tmp_path / "a.lib")
    options = ["--seconds", "0.5", "--volts-per-m-s2", "10", "--limit-v", "0.3"]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(sys, "argv", ["daq.py", str(tmp_path / "a.lib"), "felt", *options])
    runpy.run_path(str(EXAMPLES / "daq.py"), run_name="__main__")
    samples = np.concatenate(written)
    assert np.abs(samples).max() == np.float32(0.3) and not samples[-50:].any()
