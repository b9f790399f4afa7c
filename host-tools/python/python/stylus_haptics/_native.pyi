"""Types of the module in Rust. The docstrings are in the module itself: `help(stylus_haptics.fit)`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Union, final

import numpy as np
import numpy.typing as npt

from ._results import Evaluation, Fit, HattImport, Rendering, Texture

_Path = Union[str, PathLike[str]]
_Progress = Callable[[int, int], object]
_Recordings = Union[_Path, Recording, Recordings, Sequence[Union[_Path, Recording]]]
_LibraryLike = Union[_Path, Library, Fit, HattImport]
_Design = Literal["abx", "similarity", "staircase"]
_TimeUnit = Literal["s", "ms", "us", "ns"]
_Reduction = Literal["pca", "dft321", "x", "y", "z"]

__all__ = [
    "SAMPLE_RATE_HZ",
    "Device",
    "Library",
    "Motion",
    "Player",
    "Recording",
    "Recordings",
    "Scene",
    "StylusError",
    "StylusWarning",
    "__version__",
    "_read_answers",
    "_write_wav",
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
    "score",
    "simulate_rig",
]

__version__: str
SAMPLE_RATE_HZ: int

class StylusError(Exception):
    kind: str
    path: Path | None
    line: int | None

class StylusWarning(UserWarning): ...

@final
class Recording:
    def __new__(
        cls,
        samples: npt.ArrayLike,
        rate_hz: float,
        *,
        texture: str,
        speed_mm_s: float = 100.0,
        force_n: float = 1.0,
        scale_m_s2: float | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
        simulated: bool = False,
        name: str | None = None,
    ) -> Recording: ...
    @staticmethod
    def from_file(
        path: _Path,
        *,
        texture: str | None = None,
        speed_mm_s: float = 100.0,
        force_n: float = 1.0,
        scale_m_s2: float | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
        sample_rate_hz: float | None = None,
        time_unit: _TimeUnit | None = None,
        even_times: bool = False,
        simulated: bool = False,
    ) -> Recording: ...
    @property
    def name(self) -> str: ...
    @property
    def texture(self) -> str: ...
    @property
    def speed_mm_s(self) -> float: ...
    @property
    def force_n(self) -> float: ...
    @property
    def scale_m_s2(self) -> float | None: ...
    @property
    def start_s(self) -> float: ...
    @property
    def duration_s(self) -> float | None: ...
    @property
    def simulated(self) -> bool: ...
    def samples(self, rate_hz: int = 5000) -> npt.NDArray[np.float64]: ...
    def signal(
        self, *, reduce: _Reduction = "pca", high_pass: str = "auto"
    ) -> npt.NDArray[np.float64]: ...

@final
class Recordings:
    def __new__(
        cls,
        source: _Recordings,
        *,
        duration_s: float | None = None,
        sample_rate_hz: float | None = None,
        time_unit: _TimeUnit | None = None,
        even_times: bool = False,
        scale_m_s2: float | None = None,
        speed_mm_s: float = 100.0,
        force_n: float = 1.0,
    ) -> Recordings: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Recording: ...
    @property
    def textures(self) -> list[str]: ...

def fit(
    recordings: _Recordings,
    *,
    order: int | Literal["auto", "bic"] = "auto",
    reduce: _Reduction = "pca",
    high_pass: str = "auto",
    silence_floor_m_s2: float = 0.001,
    excitation: Literal["gaussian", "snippets", "auto"] = "auto",
    drop: Sequence[str] = (),
    lines: Literal["auto", "none"] = "auto",
    floor: Literal["subtract", "note", "none"] = "note",
    floor_recording: _Path | None = None,
    model_rate_hz: int = 5000,
    snap: float | Literal["clear", "auto", "none"] = "clear",
    strict: bool = False,
    progress: _Progress | None = None,
) -> Fit: ...
def fit_strokes(
    files: _Path | Sequence[_Path],
    texture: str,
    *,
    order: int | Literal["auto", "bic"] = "auto",
    reduce: _Reduction = "pca",
    high_pass: str = "auto",
    silence_floor_m_s2: float = 0.001,
    excitation: Literal["gaussian", "snippets", "auto"] = "auto",
    lines: Literal["auto", "none"] = "auto",
    sample_rate_hz: float | None = None,
    scale_m_s2: float | None = None,
    progress: _Progress | None = None,
) -> Fit: ...

@final
class Library:
    def __new__(cls, data: bytes, record: str | None = None) -> Library: ...
    def __reduce__(self) -> tuple[type[Library], tuple[bytes, str | None]]: ...
    def record(self) -> dict[str, Any] | None: ...
    @staticmethod
    def open(path: _Path) -> Library: ...
    def save(self, path: _Path, *, overwrite: bool = False) -> None: ...
    @property
    def textures(self) -> list[Texture]: ...
    @property
    def scenes(self) -> list[Scene]: ...
    def scene(self, name: str | None = None) -> Scene: ...
    def with_scenes(self, scenes: Sequence[Scene]) -> Library: ...
    def __getitem__(self, name: str, /) -> Texture: ...
    def __contains__(self, name: str, /) -> bool: ...
    def keys(self) -> list[str]: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...
    def __bytes__(self) -> bytes: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

def inspect(library: _LibraryLike) -> dict[str, Any]: ...

@final
class Motion:
    def __new__(
        cls,
        time_s: npt.ArrayLike,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        *,
        position_mm: npt.ArrayLike | None = None,
        contact: npt.ArrayLike | None = None,
    ) -> Motion: ...
    @staticmethod
    def read(path: _Path) -> Motion: ...
    @staticmethod
    def constant(speed_mm_s: float, force_n: float) -> Motion: ...
    @property
    def duration_s(self) -> float: ...
    def at(self, time_s: float) -> tuple[float, float]: ...

def render(
    library: _LibraryLike,
    texture: str,
    *,
    speed_mm_s: float | None = None,
    force_n: float | None = None,
    motion: Motion | _Path | None = None,
    seconds: float | None = None,
    seed: int = 1,
    progress: _Progress | None = None,
) -> Rendering: ...

@final
class Player:
    def __new__(
        cls,
        library: _LibraryLike,
        texture: str | None = None,
        *,
        scene: str | None = None,
        output_rate_hz: int = 48000,
        seed: int = 1,
        as_rendered: bool = False,
    ) -> Player: ...
    def move(self, speed_mm_s: float, force_n: float) -> None: ...
    def move_to(self, time_s: float, position_mm: float, force_n: float) -> None: ...
    def follow(
        self,
        speed_mm_s: float,
        force_n: float,
        *,
        begin_mm: float | None = None,
        end_mm: float | None = None,
        contact: bool | None = None,
    ) -> None: ...
    def choose(
        self,
        texture: str | None = None,
        *,
        scene: str | None = None,
        library: _LibraryLike | None = None,
        seed: int = 1,
    ) -> None: ...
    def stop(self) -> None: ...
    def set_gain(self, gain: float, limit: float = ...) -> None: ...
    def set_coil(self, ohms: float, volts_per_m_s2: float, watts: float) -> None: ...
    def fill(self, out: npt.NDArray[np.float32]) -> None: ...
    def blocks(self, samples: int) -> Iterator[npt.NDArray[np.float32]]: ...
    @property
    def output_rate_hz(self) -> int: ...
    @property
    def latency_s(self) -> float: ...
    @property
    def band_hz(self) -> float: ...
    def __enter__(self) -> Player: ...
    def __exit__(self, *_exception: object) -> None: ...

def evaluate(
    recordings: _Recordings,
    library: _LibraryLike,
    *,
    takes: _Recordings | None = None,
    reduce: _Reduction = "pca",
    high_pass: str = "auto",
    smoothing_hz: float = 20,
    synthesis_s: float = 10,
    played: Literal["fitted", "gaussian", "residual"] = "fitted",
    seed: int = 1,
    report: _Path | None = None,
    overwrite: bool = False,
    progress: _Progress | None = None,
) -> Evaluation: ...

def page(
    library: _LibraryLike,
    out: _Path,
    *,
    recordings: _Recordings | None = None,
    clips_s: float | None = None,
    reduce: _Reduction = "pca",
    high_pass: str = "auto",
    seed: int = 1,
    overwrite: bool = False,
    progress: _Progress | None = None,
) -> dict[str, str]: ...

def compare(
    recordings: _Recordings,
    library: _LibraryLike,
    out: _Path,
    *,
    takes: _Recordings | None = None,
    before: _LibraryLike | None = None,
    design: _Design = "abx",
    pairs: Sequence[str] = (),
    trials: int | None = None,
    segment_s: float = 1.5,
    reduce: _Reduction = "pca",
    high_pass: str = "auto",
    seed: int = 1,
    overwrite: bool = False,
) -> int: ...

def _read_answers(paths: _Path | Sequence[_Path]) -> list[list[tuple[str, Any]]]: ...
def score(answers: Sequence[_Path]) -> list[dict[str, Any]]: ...

def import_hatt(
    paths: _Path | Sequence[_Path],
    *,
    speeds: int | None = None,
    forces: int | None = None,
    model_rate_hz: int = 5000,
    progress: _Progress | None = None,
) -> HattImport: ...

@final
class Scene:
    @property
    def name(self) -> str: ...
    @property
    def surfaces(self) -> list[str]: ...
    @property
    def sample_rate_hz(self) -> int: ...
    @property
    def simulated(self) -> bool: ...
    @property
    def worst_case_instructions(self) -> int: ...
    @property
    def fits(self) -> bool: ...
    def cost(self) -> dict[str, Any]: ...
    def render(
        self,
        *,
        speed_mm_s: float | None = None,
        force_n: float | None = None,
        motion: Motion | _Path | None = None,
        seconds: float | None = None,
        seed: int = 1,
        progress: _Progress | None = None,
    ) -> Rendering: ...

def compile_scene(source: _Path, library: _LibraryLike, *, folder: _Path | None = None) -> Scene: ...

@final
class Device:
    def __new__(cls, link: str | None = None, *, timeout_s: float | None = None) -> Device: ...
    @property
    def link(self) -> str: ...
    @property
    def is_emulated(self) -> bool: ...
    @property
    def info(self) -> dict[str, Any]: ...
    def status(self) -> dict[str, Any]: ...
    def slots(self) -> list[dict[str, Any]]: ...
    def upload(
        self,
        library: _LibraryLike,
        *,
        activate: bool = False,
        replace_last: bool = False,
        progress: _Progress | None = None,
    ) -> str: ...
    def activate(self, slot: str | None = None) -> str: ...
    def play(
        self,
        *,
        texture: str | None = None,
        scene: str | None = None,
        speed_mm_s: float | None = None,
        force_n: float | None = None,
        motion: Motion | _Path | None = None,
        seconds: float | None = None,
        gain: float = 1.0,
        rate_hz: int = 1000,
        seed: int = 1,
        progress: _Progress | None = None,
    ) -> dict[str, Any]: ...
    def record(
        self,
        heard: Callable[[int, npt.NDArray[np.float64]], object],
        told: Callable[[dict[str, Any], float], object],
    ) -> dict[str, Any]: ...
    def stop(self) -> bool: ...
    def settings(self) -> list[dict[str, Any]]: ...
    def change_settings(self, values: Mapping[str, float], *, accept: bool = False) -> None: ...
    def close(self) -> None: ...
    def __enter__(self) -> Device: ...
    def __exit__(self, *_exception: object) -> None: ...

def _write_wav(
    path: _Path, words: npt.NDArray[np.int32], sample_rate_hz: int, pcm16_m_s2: float | None, overwrite: bool
) -> int: ...

def paper_rig() -> str: ...
def simulate_rig(out: _Path, *, rig: _Path | None = None, seed: int = 1, overwrite: bool = False) -> Recordings: ...
def devices() -> list[dict[str, Any]]: ...
