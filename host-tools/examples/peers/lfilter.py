"""Measures SciPy's lfilter in float64, in buffers of 256 samples with the state of the one before: the filter alone.

    lfilter.py FOLDER SAMPLES
"""

import sys
import time

import numpy as np
from scipy.signal import lfilter

BLOCK = 256

folder, count = sys.argv[1], int(sys.argv[2])
model = np.load(f"{folder}/node.npz")
noise, polynomial, state = model["noise"], model["polynomial"], np.zeros(len(model["polynomial"]) - 1)
samples = np.empty(count)
begin = time.process_time_ns()
for block in range(0, count, BLOCK):
    samples[block : block + BLOCK], state = lfilter([1.0], polynomial, noise[block : block + BLOCK], zi=state)
ns = time.process_time_ns() - begin
sys.stdout.buffer.write(samples.astype(np.float32).tobytes())
print(ns / count, file=sys.stderr)
