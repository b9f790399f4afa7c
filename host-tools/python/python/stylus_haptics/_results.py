"""Results as plain Python objects: arrays, tables and pickles, and a player in notebooks.

`to_dataframe` returns a `pandas.DataFrame`, and raises `ImportError` without pandas.
"""

from __future__ import annotations

import base64
import html
import importlib
import io
import wave
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from os import PathLike
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _native

# Longest part of a rendering that a notebook keeps, s: 0.5 MB as text.
_PLAYED_S = 10.0
# A rate that every browser plays, Hz.
_PLAYED_RATE_HZ = 20_000
_SIMULATED = '<strong style="color:#b33">SIMULATED</strong>'


def _frame(rows: Sequence[Mapping[str, Any]]) -> Any:
    try:
        pandas = importlib.import_module("pandas")
    except ImportError as missing:
        raise ImportError("to_dataframe needs pandas: pip install pandas") from missing
    return pandas.json_normalize([dict(row) for row in rows])


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as an HTML table; numbers with three significant digits."""

    def cell(value: object) -> str:
        return f"{value:.3g}" if isinstance(value, float) else "" if value is None else html.escape(str(value))

    heads = "".join(f"<th>{html.escape(name)}</th>" for name in rows[0]) if rows else ""
    lines = ("".join(f"<td>{cell(value)}</td>" for value in row.values()) for row in rows)
    return f"<table><tr>{heads}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


@dataclass(frozen=True, eq=False, repr=False)
class Rendering:
    """What the stylus plays along a motion. In a notebook it shows a player.

    ``samples`` are float32, m/s², of the shape (N,): those of the WAV file that ``stylus render`` writes. ``words`` are
    the kernel's own, int32, in steps of 2⁻²⁰ m/s², bit-equal on the computer and the stylus. ``sample_rate_hz`` is
    their rate, ``saturations`` the number of samples at the kernel's full scale, ``label`` the texture or scene in
    words, and ``simulated`` is true if any texture in it is of simulated recordings.
    """

    samples: npt.NDArray[np.float32]
    words: npt.NDArray[np.int32]
    sample_rate_hz: int
    saturations: int
    label: str
    simulated: bool

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return len(self.words) / self.sample_rate_hz

    def __len__(self) -> int:
        return len(self.words)

    def save(
        self, path: Union[str, PathLike[str]], *, pcm16_m_s2: float | None = None, overwrite: bool = False
    ) -> int:
        """Writes a mono WAV file, whole or not at all, and returns the number of clipped samples.

        Samples are 32-bit floats in m/s², or with `pcm16_m_s2` 16-bit integers whose full scale that is. What is there
        is replaced with `overwrite` alone; else it is a `StylusError` that names the file.
        """
        return _native._write_wav(path, self.words, self.sample_rate_hz, pcm16_m_s2, overwrite)

    def _repr_html_(self) -> str:
        shown = self.samples[: int(_PLAYED_S * self.sample_rate_hz)].astype(float)
        peak = float(np.abs(shown).max(initial=0.0))
        factor = _PLAYED_RATE_HZ // self.sample_rate_hz
        # Band-limited interpolation, so that nothing sounds above half the kernel's rate.
        dense = factor * np.fft.irfft(np.fft.rfft(shown), factor * len(shown)) if len(shown) else shown
        codes = np.clip(np.round(dense / max(peak, 1e-12) * 0.9 * 32767), -32768, 32767).astype("<i2")
        file = io.BytesIO()
        with wave.open(file, "wb") as writer:
            writer.setnchannels(1)
            writer.setsampwidth(2)
            writer.setframerate(_PLAYED_RATE_HZ)
            writer.writeframes(codes.tobytes())
        sound = base64.b64encode(file.getvalue()).decode()
        part = f"the first {_PLAYED_S:g} of " if self.duration_s > _PLAYED_S else ""
        said = f"{html.escape(self.label)}: {part}{self.duration_s:.3g} s, scaled to its peak of {peak:.3g} m/s²"
        return (
            f'<figure style="margin:0"><figcaption>{said}{f", {_SIMULATED}" if self.simulated else ""}</figcaption>'
            f'<audio controls aria-label="{html.escape(self.label)}" src="data:audio/wav;base64,{sound}"></audio>'
            "</figure>"
        )

    def __repr__(self) -> str:
        mark = ", SIMULATED" if self.simulated else ""
        return (
            f"Rendering({self.label!r}, {len(self)} samples at {self.sample_rate_hz} Hz, "
            f"{self.saturations} at full scale{mark})"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Node:
    """A node of a texture's grid: a linear predictor with its level.

    ``speed_mm_s`` and ``force_n`` are its place; ``rms_m_s2`` is the RMS of the output and
    ``prediction_error_rms_m_s2`` that of the prediction error; ``flags`` are of 'silent', 'interpolated',
    'extrapolated' and 'doubtful'. ``reflection`` holds k(1) to k(order), of the stored codes, and ``predictor`` h(1) to
    h(order): x(n) is predicted as the sum of h(i) x(n - i), at ``sample_rate_hz``.
    """

    speed_mm_s: float
    force_n: float
    rms_m_s2: float
    prediction_error_rms_m_s2: float
    flags: list[str]
    sample_rate_hz: int
    reflection: npt.NDArray[np.float64]
    predictor: npt.NDArray[np.float64]

    @property
    def order(self) -> int:
        """Order of the predictor."""
        return len(self.predictor)

    def spectrum(self, frequencies_hz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Power spectral density of the model at `frequencies_hz`, one-sided, (m/s²)²/Hz.

        It is 2 σ² / (fs |A|²), where σ² is the variance of the prediction error, fs the sample rate, and A the
        prediction error filter. Raises `StylusError` for more than 2²⁷ frequencies.
        """
        frequencies = np.asarray(frequencies_hz)
        if frequencies.size > 1 << 27:
            raise _native.StylusError(f"frequencies_hz has {frequencies.size} values: give at most {1 << 27}")
        delay = np.exp(-2j * np.pi * frequencies.astype(float) / self.sample_rate_hz)
        error_filter = np.polynomial.polynomial.polyval(delay, np.concatenate([[1.0], -self.predictor]))
        density: npt.NDArray[np.float64] = (
            2 * self.prediction_error_rms_m_s2**2 / (self.sample_rate_hz * np.abs(error_filter) ** 2)
        )
        return density

    def __repr__(self) -> str:
        flags = "".join(f", {flag}" for flag in self.flags)
        return (
            f"Node(speed_mm_s={self.speed_mm_s:g}, force_n={self.force_n:g}, order={self.order}, "
            f"rms_m_s2={self.rms_m_s2:.4f}{flags})"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Texture:
    """A texture: models over a grid of speeds and forces.

    ``speeds_mm_s`` and ``forces_n`` are the axes, ascending, ``sample_rate_hz`` is the rate of its models,
    ``simulated`` is true if its recordings were, ``level_is_known`` is false if nothing stated the acceleration of
    their integers, and ``nodes`` are its nodes, all forces of a speed after each other.
    Arrays over the grid have the shape (speeds, forces).
    """

    name: str
    simulated: bool
    level_is_known: bool
    sample_rate_hz: int
    speeds_mm_s: npt.NDArray[np.float64]
    forces_n: npt.NDArray[np.float64]
    nodes: list[Node]

    def _grid(self, values: Iterable[Any], kind: type) -> npt.NDArray[Any]:
        return np.array(list(values), kind).reshape(len(self.speeds_mm_s), len(self.forces_n))

    @property
    def orders(self) -> npt.NDArray[np.int64]:
        """Orders of the models."""
        return self._grid((node.order for node in self.nodes), np.int64)

    @property
    def rms_m_s2(self) -> npt.NDArray[np.float64]:
        """RMS of the outputs, m/s²; 0 of silent nodes."""
        return self._grid((node.rms_m_s2 for node in self.nodes), float)

    @property
    def filled(self) -> npt.NDArray[np.bool_]:
        """True of nodes without a recording of their own, which were filled from neighbours."""
        return self._grid(({"interpolated", "extrapolated"} & set(node.flags) for node in self.nodes), bool)

    @property
    def silent(self) -> npt.NDArray[np.bool_]:
        """True of silent nodes."""
        return self._grid(("silent" in node.flags for node in self.nodes), bool)

    @property
    def doubtful(self) -> npt.NDArray[np.bool_]:
        """True of nodes with a doubtful recording."""
        return self._grid(("doubtful" in node.flags for node in self.nodes), bool)

    def node(self, speed_index: int, force_index: int) -> Node:
        """The node at these indices of the axes. Raises `IndexError` off the grid."""
        speeds, forces = len(self.speeds_mm_s), len(self.forces_n)
        if not (0 <= speed_index < speeds and 0 <= force_index < forces):
            raise IndexError(f"the grid has {speeds} speeds and {forces} forces")
        return self.nodes[speed_index * forces + force_index]

    def to_dataframe(self) -> Any:
        """The nodes, a row each, without their coefficients."""
        names = ("speed_mm_s", "force_n", "order", "rms_m_s2", "prediction_error_rms_m_s2", "flags")
        return _frame([{name: getattr(node, name) for name in names} for node in self.nodes])

    def __repr__(self) -> str:
        mark = ", SIMULATED" if self.simulated else ""
        return f"Texture({self.name!r}, {len(self.speeds_mm_s)} speeds x {len(self.forces_n)} forces{mark})"


@dataclass(frozen=True)
class TrialReport:
    """The account of one recording that a fit gives.

    ``name`` is the file, or the name of samples in memory; ``speed_mm_s`` and ``force_n`` its motion; ``rms_m_s2`` the
    RMS of its one axis; ``mean_m_s2`` the largest magnitude of an axis's mean, which was removed; ``energy_share`` the
    share of the axes' energy that one axis keeps; ``cut_s`` what triage cut out, s; ``seconds`` what is behind its
    model; ``floor_shares`` the share of the rig's noise in its power in each third octave from 20 Hz to 2 kHz, ``None``
    if it is not known; ``verdicts`` the findings of triage in words, none for a
    sound recording; ``used`` is true if the fit used it.
    """

    name: str
    texture: str
    speed_mm_s: float
    force_n: float
    rms_m_s2: float
    mean_m_s2: float
    energy_share: float
    cut_s: float
    seconds: float
    floor_shares: list[float] | None
    verdicts: list[str]
    used: bool


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The outcome of a fit.

    ``library`` has the record of the fit, ``trials`` is the account of every recording in the order of the set, and
    ``warnings`` are notes on what is doubtful, one line each; each was warned of, too.
    """

    library: _native.Library
    trials: list[TrialReport]
    warnings: list[str]

    def record(self) -> dict[str, Any]:
        """The record of the fit as plain objects, as in LIB.fit.json: options, excitations, lines and recordings."""
        record = self.library.record()
        assert record is not None
        return record

    def save(self, path: Union[str, PathLike[str]], *, overwrite: bool = False) -> None:
        """Writes the library to `path`, and beside it the record, PATH.fit.json. See `Library.save`."""
        self.library.save(path, overwrite=overwrite)

    def to_dataframe(self) -> Any:
        """The accounts of the recordings, a row each."""
        return _frame([asdict(trial) for trial in self.trials])

    def __repr__(self) -> str:
        return f"Fit(library={self.library!r}, {len(self.trials)} recordings, {len(self.warnings)} warnings)"


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """The outcome of an evaluation; in a notebook, its table.

    Arrays have one row per recording, in the order of the set; figures that do not exist are NaN. ``figures`` is what
    `as_dict` returns.
    """

    figures: dict[str, Any] = field(repr=False)

    def _of_trials(self, name: str) -> npt.NDArray[np.float64]:
        return np.array([trial[name] for trial in self.figures["trials"]], dtype=float)

    @property
    def held_out(self) -> str:
        """The data that were held out, in words."""
        return str(self.figures["held_out"])

    @property
    def simulated(self) -> bool:
        """True if any recording behind it is simulated."""
        return bool(self.figures["simulated"])

    @property
    def cost(self) -> npt.NDArray[np.float64]:
        """Cost C of each recording; a share."""
        return self._of_trials("cost")

    @property
    def log_spectral_distance_db(self) -> npt.NDArray[np.float64]:
        """Log-spectral distance of each recording, dB."""
        return self._of_trials("log_spectral_distance_db")

    @property
    def band_errors_db(self) -> npt.NDArray[np.float64]:
        """Level of the synthesis over the recording's in each third octave, dB, of the shape (recordings, bands)."""
        return self._of_trials("band_errors_db")

    @property
    def bands_hz(self) -> npt.NDArray[np.float64]:
        """Nominal centre frequencies of the third octaves, Hz."""
        return np.array(self.figures["bands_hz"], dtype=float)

    def as_dict(self) -> dict[str, Any]:
        """All figures as plain objects: those of `stylus evaluate --json-out`."""
        return self.figures

    def to_dataframe(self) -> Any:
        """The figures of each recording, a row each; figures within others have names with dots: 'other.cost'."""
        return _frame(self.figures["trials"])

    def _repr_html_(self) -> str:
        def row(texture: Mapping[str, Any]) -> dict[str, Any]:
            other = texture.get("other") or {}
            return {
                "texture": texture["texture"],
                "recordings": texture["trials"],
                "C": texture["mean_cost"],
                "C of another part": texture["mean_cost_other"],
                "|third octaves|, dB": texture["mean_band_error_db"],
                "of another part, dB": other.get("mean_band_error_db"),
            }

        said = html.escape(self.held_out) + (f" {_SIMULATED}" if self.simulated else "")
        return f"<p>{said}</p>{_table([row(texture) for texture in self.figures['textures']])}"

    def __len__(self) -> int:
        return len(self.figures["trials"])

    def __repr__(self) -> str:
        def of(texture: Mapping[str, Any]) -> str:
            cost, distance = texture["mean_cost"], texture["mean_log_spectral_distance_db"]
            cost, distance = (float("nan") if value is None else value for value in (cost, distance))
            return f"{texture['texture']}: C {100 * cost:.1f} %, {distance:.2f} dB"

        return f"Evaluation({'; '.join(map(of, self.figures['textures']))})"


@dataclass(frozen=True, eq=False, repr=False)
class HattImport:
    """A library of HaTT's models, with the errors of the conversion.

    ``library`` is the library, ``warnings`` are notes on what is doubtful, one line each; each was warned of, too.
    ``figures`` is what `as_dict` returns.
    """

    library: _native.Library
    warnings: list[str]
    figures: list[dict[str, Any]] = field(repr=False)

    def as_dict(self) -> list[dict[str, Any]]:
        """The errors of the conversion, place by place, as plain objects: those of `stylus import-hatt --json`."""
        return self.figures

    def __repr__(self) -> str:
        return f"HattImport({self.library!r})"


def report(recordings: Any, library: Any, out: Union[str, PathLike[str]], **options: Any) -> Evaluation:
    """Evaluates as `evaluate` does, with its `options`, and writes the page on it, OUT/index.html.

    The page has pictures and sounds. `out` is a folder that is new or empty; an earlier report is replaced with
    `overwrite=True` alone.
    """
    return _native.evaluate(recordings, library, report=out, **options)
