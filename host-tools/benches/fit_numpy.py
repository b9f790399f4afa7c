"""A fit of a recording set with NumPy and SciPy, as a reference for the speed of `stylus fit --order 400`.

Usage: python3 fit_numpy.py RECORDINGS OUT.npz
"""
import csv, pathlib, sys
import numpy as np
from scipy.io import wavfile
from scipy.linalg import solve_toeplitz

folder, out, order = pathlib.Path(sys.argv[1]), sys.argv[2], 400
with open(folder / "trials.csv") as lines:
    trials = list(csv.DictReader(line for line in lines if not line.startswith("#")))
models, powers = np.zeros((len(trials), order)), np.zeros(len(trials))
for index, trial in enumerate(trials):
    axes = wavfile.read(folder / trial["file"])[1].astype(float)
    axes -= axes.mean(axis=0)
    direction = np.linalg.eigh(axes.T @ axes)[1][:, -1]
    signal = axes @ direction
    length = 1 << (len(signal) + order).bit_length()
    lags = np.fft.irfft(np.abs(np.fft.rfft(signal, length)) ** 2)[: order + 1] / len(signal)
    if lags[0] > 0:
        models[index] = solve_toeplitz(lags[:order] * np.r_[1 + 1e-9, np.ones(order - 1)], lags[1:])
        powers[index] = lags[0] - models[index] @ lags[1:]
np.savez(out, models=models, powers=powers)
