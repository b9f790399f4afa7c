"""Plays a texture on an analog output of a DAQ of National Instruments, along a motion that is read in a loop.

    pip install nidaqmx    # and the driver NI-DAQmx
    python daq.py LIBRARY TEXTURE [--channel Dev1/ao0] [--volts-per-m-s2 GAIN] [--limit-v V]

Replace `motion` by what your rig measures. The converter takes BLOCK samples at a time from a buffer of three blocks,
so that what is felt lags by 15 ms at most, and 2 ms of the player.
"""

import argparse
import math
import time

import nidaqmx
import numpy as np
import stylus_haptics as sh
from nidaqmx.constants import AcquisitionType, RegenerationMode

RATE_HZ = 10_000
BLOCK = 50


def motion(time_s):
    """Speed, mm/s, and force, N: strokes of 100 mm, two per second."""
    return 100 * math.pi * 2 * math.sin(2 * math.pi * 2 * time_s) / 2, 1.0


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("library")
    arguments.add_argument("texture")
    arguments.add_argument("--channel", default="Dev1/ao0")
    arguments.add_argument("--volts-per-m-s2", type=float, default=0.01, help="gain of amplifier and actuator, inverse")
    arguments.add_argument("--limit-v", type=float, default=0.5, help="most that is put out, V (default 0.5)")
    arguments.add_argument("--seconds", type=float, default=math.inf)
    asked = arguments.parse_args()

    with sh.Player(asked.library, asked.texture, output_rate_hz=RATE_HZ) as player, nidaqmx.Task() as task:
        player.set_gain(asked.volts_per_m_s2, asked.limit_v)
        task.ao_channels.add_ao_voltage_chan(asked.channel, min_val=-asked.limit_v, max_val=asked.limit_v)
        task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=3 * BLOCK)
        # Never the same block twice: without a new one the converter stops.
        task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        block = np.zeros(BLOCK, "float32")
        task.write(np.zeros(2 * BLOCK))
        task.start()
        begun = time.monotonic()
        while (now := time.monotonic() - begun) < asked.seconds:
            player.move(*motion(now))
            player.fill(block)
            # Waits until the buffer has room.
            task.write(block.astype("float64"))
        # The last blocks are silent before the task ends.
        player.stop()
        for _ in range(20):
            player.fill(block)
            task.write(block.astype("float64"))


if __name__ == "__main__":
    main()
