"""The plant behind `render --plant`, against SciPy on the equations of `host-tools/plant/README.md`, written anew."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import wavfile

STEP_S = 25e-6
PLANT = {
    "coil": {
        "resistance_ohm": 5.0,
        "inductance_h": 2e-4,
        "force_n_per_a": 1.7,
        "moving_mass_kg": 6e-3,
        "stiffness_n_per_m": 900.0,
        "damping_n_s_per_m": 0.6,
        "rated_watts": 1.0,
    },
    "amplifier": {
        "gain": 3.0,
        "offset_volts": 0.02,
        "low_hz": 12.0,
        "high_hz": 15e3,
        "clip_volts": 0.12,
        "wake_s": 0.002,
    },
    "body": {"mass_kg": 0.03},
    "hand": {"stiffness_n_per_m": 700.0, "damping_n_s_per_m": 1.5},
    "accelerometer": {
        "main_axis": "y",
        "tilt_deg": 10.0,
        "azimuth_deg": 0.0,
        "volts_per_m_s2": 0.03,
        "rest_volts": [0.0, 0.0, 0.0],
        "noise_m_s2_per_root_hz": [0.0, 0.0, 0.0],
        "bandwidth_hz": [1600.0, 1600.0, 550.0],
        "saturation_m_s2": 35.0,
    },
}
HARDENING = 'kind = "moving-resonance"\ndoubles_at_m = 1e-5\n'


def stages(pin: np.ndarray) -> np.ndarray:
    """The voltage that the amplifier holds in each step."""
    amplifier = PLANT["amplifier"]
    corner = 2 * np.pi * amplifier["low_hz"]
    charge, held = 0.0, []
    for step, volts in enumerate(np.concatenate([[0.0], pin[:-1]])):
        after = volts + (charge - volts) * np.exp(-corner * STEP_S)
        # The mean over the step of what passes is what charges it.
        passed = (after - charge) / (corner * STEP_S)
        charge = after
        volts = np.clip(passed * amplifier["gain"] + amplifier["offset_volts"], -0.12, 0.12)
        held.append(volts if step * STEP_S >= amplifier["wake_s"] - 1e-9 else 0.0)
    return np.array(held)


def accelerations(pin: np.ndarray, hardening_m: float) -> np.ndarray:
    """The tip's acceleration at the end of each step."""
    coil, body, hand = PLANT["coil"], PLANT["body"]["mass_kg"], PLANT["hand"]
    corner = 2 * np.pi * PLANT["amplifier"]["high_hz"]

    def derivative(_, state, stage):
        volts, current, x, x_speed, y, y_speed = state
        spring = coil["stiffness_n_per_m"] * y * (1 + (y / hardening_m) ** 2)
        force = coil["force_n_per_a"] * current + spring + coil["damping_n_s_per_m"] * y_speed
        grip = hand["stiffness_n_per_m"] * x + hand["damping_n_s_per_m"] * x_speed
        x_acceleration = (force - grip) / body
        back = coil["force_n_per_a"] * y_speed
        return [
            corner * (stage - volts),
            (volts - coil["resistance_ohm"] * current + back) / coil["inductance_h"],
            x_speed,
            x_acceleration,
            y_speed,
            -force / coil["moving_mass_kg"] - x_acceleration,
        ]

    state, found = np.zeros(6), []
    for stage in stages(pin):
        solved = solve_ivp(derivative, (0, STEP_S), state, "DOP853", rtol=1e-9, atol=1e-13, args=(stage,))
        state = solved.y[:, -1]
        found.append(derivative(0, state, stage)[3])
    return np.array(found)


@pytest.mark.parametrize("hardening_m, tolerance", [(np.inf, 1e-5), (1e-5, 1e-3)])
def test_scipy_finds_the_tips_acceleration_too(command, tmp_path, hardening_m, tolerance):
    text = "\n".join(
        f"[{table}]\n" + "\n".join(f"{key} = {json.dumps(value)}" for key, value in values.items())
        for table, values in PLANT.items()
    )
    if hardening_m < np.inf:
        text += f"\n[[faults]]\n{HARDENING}"
    (tmp_path / "plant.toml").write_text(text)
    stroke = ["render", "a.lib", "--texture", "felt", "--speed", 120, "--force", 0.8, "--seconds", 0.03, "--seed", 5]
    loud = ["--set", "soft-start=1", "--set", "output-gain=0.1"]
    found = []
    for name, of in [("pin", ["--pin"]), ("tip", ["--plant", tmp_path / "plant.toml"])]:
        command.succeed(*stroke, *loud, *of, "--out", tmp_path / f"{name}.wav")
        rate, samples = wavfile.read(tmp_path / f"{name}.wav")
        assert rate == 40_000
        found.append(samples.astype(float))
    pin, tip = found
    expected = accelerations(pin, hardening_m)
    assert np.sqrt(np.mean(expected**2)) > 0.3
    assert np.abs(3 * pin).max() > 0.15, "it is to clip"
    error = np.sqrt(np.mean((tip - expected) ** 2) / np.mean(expected**2))
    assert error < tolerance
