"""Data-driven haptic textures, as the command ``stylus`` makes and plays them.

    >>> import stylus_haptics as sh
    >>> fit = sh.fit("recordings")                            # a folder with trials.csv, files, or Recordings
    >>> played = sh.render(fit, "denim", speed_mm_s=130, force_n=0.8, seconds=5)
    >>> played.samples                                        # m/s², float32, at played.sample_rate_hz

The same input gives the same bits as the command. Units are in the names: speeds in mm/s, forces in N, accelerations in
m/s², times in s, frequencies in Hz. A failure is a ``StylusError`` with the command's one line; something doubtful is a
``StylusWarning``. Long work runs without the interpreter's lock, tells ``progress(done, total)``, and ends by Ctrl-C.
"""

from . import _native
from ._native import *

__all__: list[str] = []
__all__ += _native.__all__
