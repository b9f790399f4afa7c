"""Plays a texture on a sound card, such as a Haptuator behind an amplifier, along the pointer in a window.

    pip install sounddevice
    python sound_card.py LIBRARY TEXTURE [--device DEVICE] [--force N] [--volts-per-m-s2 GAIN]

Right and left across the window is a stroke of the width that --width tells; the force is the same throughout, because
a pointer has none. Two threads: the window moves, the sound card's callback fills.
"""

import argparse
import time
import tkinter

import sounddevice
import stylus_haptics as sh

RATE_HZ = 48_000


def asked():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("library")
    arguments.add_argument("texture")
    arguments.add_argument("--device", help="output of `python -m sounddevice`; else the system's own")
    arguments.add_argument("--force", type=float, default=1.0, help="normal force, N (default 1)")
    arguments.add_argument("--width", type=float, default=300.0, help="width of the window, mm (default 300)")
    arguments.add_argument("--gain", type=float, default=0.01, help="share of full scale per m/s² (default 0.01)")
    return arguments.parse_args()


def stream(player, device=None):
    """The sound card's stream of `player`, to be started. Full scale is 1."""

    def callback(out, _frames, _time, status):
        player.fill(out[:, 0])
        if status:
            print(status)

    return sounddevice.OutputStream(
        samplerate=player.output_rate_hz, channels=1, dtype="float32", latency="low", device=device, callback=callback
    )


def main():
    arguments = asked()
    with sh.Player(arguments.library, arguments.texture, output_rate_hz=RATE_HZ) as player:
        # No more than a tenth of full scale until somebody has listened: raise --gain first, then this.
        player.set_gain(arguments.gain, limit=0.1)
        window = tkinter.Tk()
        window.title(f"{arguments.texture}: move the pointer here")
        window.geometry("900x200")
        at = [0.0]

        def moved(event):
            at[0] = event.x * arguments.width / window.winfo_width()

        # A pointer that rests sends no events, and a motion is held for 50 ms, so the position is told on a clock.
        def tell():
            player.move_to(time.monotonic(), at[0], arguments.force)
            window.after(5, tell)

        window.bind("<Motion>", moved)
        with stream(player, arguments.device):
            tell()
            window.mainloop()


if __name__ == "__main__":
    main()
