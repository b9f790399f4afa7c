"""Publishes what a stylus records on the Lab Streaming Layer until Ctrl-C, also over a cable that is pulled.

    python lsl_outlet.py [LINK] [--seconds S]
"""

import argparse
import time

import stylus_haptics as sh
from stylus_haptics.lsl import Outlets

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("link", nargs="?", help="usb:SERIAL, serial:PATH or tcp:HOST:PORT; else the only one attached")
arguments.add_argument("--seconds", type=float, help="until Ctrl-C if it is left out")
asked = arguments.parse_args()

outlets = None
while True:
    try:
        with sh.Device(asked.link) as stylus:
            outlets = outlets or Outlets(stylus)
            print(f"{stylus.link}: on the air", flush=True)
            print(outlets.follow(stylus, asked.seconds))
            break
    except sh.StylusError as lost:
        if outlets is None:
            raise SystemExit(str(lost))
        print(f"{lost}; trying again", flush=True)
        time.sleep(1)
    except KeyboardInterrupt:
        break
if outlets is not None:
    print(f"clocks: {outlets.clock.drift_ppm:.1f} ppm, known to {1e3 * outlets.clock.uncertainty_s:.2f} ms")
