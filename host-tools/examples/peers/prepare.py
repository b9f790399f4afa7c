"""Writes what the programs play: one node of a library as a lattice, as second-order sections and as a polynomial.

    nodes LIBRARY | prepare.py FOLDER

The library is that of the tutorial's rig. The node is that at 120 mm/s and 0.5 N, and `middle.npz` is what the player
plays between it and its neighbours, at 150 mm/s and 0.75 N: the mean of θ and of the level in dB.
"""

import sys

import numpy as np

SAMPLES = 1 << 18
NODE, NEIGHBOURS = 2, [2, 3, 4, 5]  # speed-major, of 4 speeds and 2 forces
RMS = 2.0**27  # of what a filter of integers puts out: 24 dB below full scale
COEFFICIENT = 2.0**29  # 1 in a section
FREQUENCIES = np.exp(-1j * np.pi * (np.arange(1 << 13) + 0.5) / (1 << 13))


def polynomial(reflection):
    """The denominator that the lattice has, by the step-up recursion."""
    a = np.ones(1)
    for k in reflection:
        a = np.append(a, 0) + k * np.append(a, 0)[::-1]
    return a


def rms(response):
    return np.sqrt(np.mean(np.abs(response) ** 2))


def sections(a):
    """Second-order sections of 1/a in an order that keeps their signals flat, each as b0, b1, b2, a1 and a2.

    Each next section is the one that makes the response so far the flattest. b0 keeps the signals' RMS.
    """
    roots = np.roots(a)
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    pairs = [(2 * root.real, -(abs(root) ** 2)) for root in roots if root.imag >= 1e-9]
    pairs += [(p + q, -p * q) for p, q in zip(real[::2], real[1::2], strict=True)]
    responses = [1 / (1 - p * FREQUENCIES - q * FREQUENCIES**2) for p, q in pairs]
    response, rows, left = np.ones_like(FREQUENCIES), [], list(range(len(pairs)))
    while left:
        peaks = [np.abs(response * responses[at]).max() / rms(response * responses[at]) for at in left]
        at = left.pop(int(np.argmin(peaks)))
        b0 = rms(response) / rms(response * responses[at])
        rows.append([b0, 0, 0, *pairs[at]])
        response = response * responses[at]
    wrong_db = 20 * np.log10(np.abs(response * np.polyval(a[::-1], FREQUENCIES)))
    assert np.abs(wrong_db).max() < 0.1, "the polynomial's roots are not exact enough"
    assert np.abs(rows).max() < 4, "a coefficient is beyond what a word holds"
    return np.array(rows)


def words(numbers):
    return np.round(np.clip(numbers, -(2.0**31), 2.0**31 - 1)).astype("<i4")


folder = sys.argv[1]
rows = np.array([line.split() for line in sys.stdin], dtype=float)
power, theta = rows[:, 0], rows[:, 1:]
white = np.random.default_rng(1).standard_normal(SAMPLES)
middle = np.exp(np.log(power[NEIGHBOURS]).mean()), theta[NEIGHBOURS].mean(axis=0)
for name, (output, angles) in {"node": (power[NODE], theta[NODE]), "middle": middle}.items():
    gain = np.sqrt(output * np.prod(np.cos(angles) ** 2))
    a = polynomial(np.sin(angles))
    np.savez(f"{folder}/{name}.npz", polynomial=a, noise=white * gain, rms=np.sqrt(output))

words(np.sin(theta[NODE])[::-1] * 2**31).tofile(f"{folder}/lattice.i32")
words(white * RMS * np.prod(np.cos(theta[NODE]))).tofile(f"{folder}/noise-of-lattice.i32")
a = polynomial(np.sin(theta[NODE]))
words(sections(a) * COEFFICIENT).tofile(f"{folder}/sections.i32")
words(white * RMS).tofile(f"{folder}/noise-of-sections.i32")
