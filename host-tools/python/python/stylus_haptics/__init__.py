"""Data-driven haptic textures, as the command ``stylus`` makes and plays them.

    >>> import stylus_haptics as sh
    >>> fit = sh.fit("recordings")                            # a folder with trials.csv, files, or Recordings
    >>> played = sh.render(fit, "denim", speed_mm_s=130, force_n=0.8, seconds=5)
    >>> played.samples                                        # m/s², float32, at played.sample_rate_hz
    >>> sh.report("recordings", fit, "report")                # a folder with a page: figures, pictures, sounds
    >>> sh.page(fit, "page.html", recordings="recordings")    # to rub in a browser
    >>> player = sh.Player(fit, "denim", output_rate_hz=48000)  # in real time: player.move(130, 0.8), player.fill(out)

The same input gives the same bits as the command. Units are in the names: speeds in mm/s, forces in N, accelerations in
m/s², times in s, frequencies in Hz. A failure is a ``StylusError`` with the command's one line; something doubtful is a
``StylusWarning``. Long work runs without the interpreter's lock, tells ``progress(done, total)``, and ends by Ctrl-C.
"""

from ._native import *
from ._results import Evaluation, Fit, HattImport, Node, Rendering, Texture, TrialReport, report

# The list once more, because checkers of types read no other module's.
__all__ = [
    "SAMPLE_RATE_HZ",
    "Device",
    "Evaluation",
    "Fit",
    "HattImport",
    "Library",
    "Motion",
    "Node",
    "Player",
    "Recording",
    "Recordings",
    "Rendering",
    "Scene",
    "StylusError",
    "StylusWarning",
    "Texture",
    "TrialReport",
    "__version__",
    "compare",
    "compile_scene",
    "devices",
    "evaluate",
    "fit",
    "fit_strokes",
    "import_hatt",
    "inspect",
    "page",
    "paper_rig",
    "render",
    "report",
    "score",
    "simulate_rig",
]
