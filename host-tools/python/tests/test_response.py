"""A calibration of the response over a link, and SciPy's judgement of the plant's own tip."""

import subprocess

import numpy as np
import pytest
import stylus_haptics as sh
from scipy import signal

from conftest import needed

COIL = ("--resistance", 6, "--amplifier-gain", 2, "--power-limit", 0.5, "--hard-limit", 0.7, "--keep-force")
BANDWIDTH = ("--accelerometer-bandwidth", "1600,1600,550")
RATE_HZ = 5000


@pytest.fixture
def plant(tmp_path):
    """The link of a fake stylus with a plant, and the log of its pin and tip."""
    log = tmp_path / "plant.f32"
    words = [needed("STYLUS_FAKE"), "--plant", "haptuator", "--plant-seed", "0", "--log", str(log)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout and process.stdin
        yield process.stdout.readline().strip(), log
        process.stdin.close()


def third_octaves(samples: np.ndarray) -> np.ndarray:
    """Power in the third octaves of 40 to 800 Hz, after half a second."""
    powers = []
    for band in range(16, 30):
        edges = 10 ** (band / 10 + np.array([-0.05, 0.05]))
        sections = signal.butter(4, edges, "bandpass", fs=RATE_HZ, output="sos")
        powers.append(np.mean(signal.sosfilt(sections, samples)[RATE_HZ // 2 :] ** 2))
    return np.array(powers)


def test_a_calibrated_tip_does_what_the_library_asks(command, fitted, plant):
    link, log = plant
    link = ("--link", link)
    command.succeed("upload", "a.lib", "--activate", *link)
    played = ("--texture", "felt", "--speed", 120, "--force", 0.8, "--seconds", 3)

    def tip() -> np.ndarray:
        begin = log.stat().st_size
        command.succeed("play", *played, *link)
        return np.fromfile(log, "<f4", offset=begin - begin % 8)[1::2].astype(float)

    before = tip()
    report = command.json("calibrate", *COIL, "--response", *BANDWIDTH, "--yes", "--json", *link)["response"]
    assert report["verdict"] == "pass" and report["found"]["seconds"] <= 60
    # All of it, the upwards steps and the proof: no sample at the pin beyond the limits of voltage and slew.
    pin = np.fromfile(log, "<f4")[::2]
    assert np.abs(pin).max() <= 0.7 and np.abs(np.diff(pin)).max() <= 4 / 40 + 1e-3
    command.succeed("check", *BANDWIDTH, *link)
    after = tip()
    asked = sh.render(fitted, "felt", speed_mm_s=120, force_n=0.8, seconds=3).samples

    wanted = third_octaves(np.asarray(asked, float))
    loud = wanted > 1e-3 * wanted.max()

    def off(samples: np.ndarray) -> np.ndarray:
        # The texture alone, without the time before and after it.
        samples = signal.resample_poly(samples, 1, 8)
        sounding = np.flatnonzero(np.abs(samples) > 0.2 * np.abs(samples).max())
        return 10 * np.log10(third_octaves(samples[sounding[0] : sounding[-1]]) / wanted)[loud]

    assert np.abs(off(after)).max() < 1.5 + 1.0, (off(before), off(after))
    assert np.abs(off(after)).mean() < np.abs(off(before) - off(before).mean()).mean()
    shown = command.json("headroom", "a.lib", "--json", *link)
    assert shown["calibrated"] and {texture["texture"] for texture in shown["textures"]} == {"felt", "cork"}
