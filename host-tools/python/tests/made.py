"""Recordings and model files that are made up, by code that is not under test."""

import math
import struct
import zlib
from pathlib import Path

import numpy as np


def recording(texture: str, axes: int, speed_mm_s: float, force_n: float, seconds: float = 2.0) -> np.ndarray:
    """Noise through a resonance that rises with the speed and a level that rises with both, (N, axes) or (N,), m/s²."""
    seed = zlib.crc32(f"{texture} {speed_mm_s} {force_n}".encode())
    generator = np.random.default_rng(seed)
    count = int(5000 * seconds)
    pole = 0.97 * np.exp(2j * np.pi * (60 + speed_mm_s) / 5000)
    first, second = 2 * pole.real, -abs(pole) ** 2
    noise = generator.standard_normal(count)
    signal = np.zeros(count)
    for n in range(2, count):
        signal[n] = first * signal[n - 1] + second * signal[n - 2] + noise[n]
    signal *= 0.002 * speed_mm_s * math.sqrt(force_n) / signal.std()
    if axes == 1:
        return signal
    direction = np.array([0.8, 0.5, 0.33])
    own = generator.standard_normal((count, 3)) * 0.01
    return signal[:, None] * direction + own


def write_float_wav(path: Path, samples: np.ndarray, rate_hz: int) -> None:
    """A WAV file of 64-bit floats, by the format's own description."""
    frames = np.atleast_2d(samples.T).T.astype("<f8")
    channels = frames.shape[1]
    data = frames.tobytes()
    form = struct.pack("<HHIIHH", 3, channels, rate_hz, rate_hz * channels * 8, channels * 8, 64)
    body = b"WAVEfmt " + struct.pack("<I", len(form)) + form + b"data" + struct.pack("<I", len(data)) + data
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)


def read_float_wav(path: Path) -> tuple[int, np.ndarray]:
    """Rate, Hz, and samples of a mono WAV file of 32-bit floats."""
    data = path.read_bytes()
    assert data[:4] == b"RIFF" and data[8:12] == b"WAVE"
    at, rate_hz = 12, 0
    while at < len(data):
        name, length = data[at : at + 4], struct.unpack_from("<I", data, at + 4)[0]
        if name == b"fmt ":
            rate_hz = struct.unpack_from("<I", data, at + 12)[0]
        if name == b"data":
            return rate_hz, np.frombuffer(data, "<f4", length // 4, at + 8)
        at += 8 + length + length % 2
    raise AssertionError("no samples")


def hatt_models() -> str:
    """A file of HaTT's shape: models of order 2 at the corners of a square and in its middle."""
    places = [(0, 0, 0.0), (200, 0, 0.0), (0, 2, 0.0), (200, 2, 0.02), (80, 0.8, 0.01)]
    triangles = [(1, 2, 5), (2, 4, 5), (4, 3, 5), (3, 1, 5)]

    def values(numbers):
        return "".join(f"<value>{number:.9f}</value>" for number in numbers)

    def model(number, speed, force, variance):
        lines = [0.5 + 0.001 * speed, 1.2 + 0.001 * speed]
        # A(z) of order 2 from its line spectral frequencies: half the sum of its two symmetric parts.
        first, second = (-2 * math.cos(line) for line in lines)
        a = [1.0, (first + 1 + second - 1) / 2, (1 + first + 1 - second) / 2]
        return (
            f"<model><modNum>{number}</modNum><ARcoeff>{values(a)}</ARcoeff><ARlsf>{values(lines)}</ARlsf>"
            f"<MAcoeff>{values([1.0])}</MAcoeff><MAlsf></MAlsf><var>{variance}</var><gain>1</gain>"
            f"<speedMod>{speed}</speedMod><forceMod>{force}</forceMod></model>"
        )

    whole = [f"<tri type=\"array\">{''.join(f'<value>{n}</value>' for n in one)}</tri>" for one in triangles]
    models = [model(number, *place) for number, place in enumerate(places, 1)]
    return (
        '<?xml version="1.0" encoding="utf-8"?><modelSet texture="7"><material>Felt</material>'
        "<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits>"
        f"<SampleRate>1000</SampleRate><mu>0.3</mu><numMod>{len(places)}</numMod><numTri>{len(triangles)}</numTri>"
        "<maxSpeed>200</maxSpeed><maxForce>2</maxForce>"
        f"<speedList type=\"array\">{values(p[0] for p in places)}</speedList>"
        f"<forceList type=\"array\">{values(p[1] for p in places)}</forceList>{''.join(whole)}"
        f"<numARCoeff>2</numARCoeff><numMACoeff>0</numMACoeff>{''.join(models)}</modelSet>\n"
    )
