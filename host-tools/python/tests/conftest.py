"""Fixtures: recordings by two ways, the command to compare with, and a fake stylus.

The command is `$STYLUS_PROGRAM`, and the fake stylus `$STYLUS_FAKE`; `tests/run` builds both. Without them the tests
fail, because equality with the command is what most of them hold.
"""

import fcntl
import json
import os
import signal
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
import stylus_haptics as sh

import made

SPEEDS_MM_S = (80.0, 160.0)
FORCES_N = (0.5, 1.0)


# Timeout of an answer that only a fault reaches, however busy this computer is, s.
ANSWER_S = 600


def needed(name: str) -> str:
    program = os.environ.get(name)
    assert program, f"set {name}: `tests/run` does, or build it by cargo"
    return program


class Command:
    """The command `stylus` in a folder."""

    def __init__(self, folder: Path):
        self.folder = folder

    def run(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        words = [needed("STYLUS_PROGRAM"), *map(str, arguments)]
        patient = {"STYLUS_TIMEOUT": str(ANSWER_S), **os.environ}
        return subprocess.run(words, cwd=self.folder, capture_output=True, text=True, env=patient)

    def succeed(self, *arguments: object) -> str:
        done = self.run(*arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def refuse(self, *arguments: object) -> str:
        """The line of a failure, without the program's name."""
        done = self.run(*arguments)
        assert done.returncode == 2, done.stderr
        return done.stderr.rstrip("\n").rpartition("\n")[2].removeprefix("stylus: ")

    def json(self, *arguments: object):
        return json.loads(self.succeed(*arguments))


@pytest.fixture
def ctrl_c():
    """An event at which Ctrl-C is pressed. A program in the background of a shell ignores it, so that Python's own
    handler is set here."""
    begun = threading.Event()

    def press() -> None:
        begun.wait()
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=press, daemon=True).start()
    yield begun
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def signals() -> dict[tuple[str, float, float], np.ndarray]:
    """Samples of two textures at two speeds and two forces, m/s², 2 s at 5 kHz: one of three axes, one of one."""
    made_of = {}
    for texture, axes in (("felt", 3), ("cork", 1)):
        for speed in SPEEDS_MM_S:
            for force in FORCES_N:
                made_of[texture, speed, force] = made.recording(texture, axes, speed, force)
    return made_of


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, signals) -> Path:
    """The same samples as a folder with `trials.csv` and WAV files of 64-bit floats."""
    folder = tmp_path_factory.mktemp("recordings")
    lines = ["file,texture,speed_mm_s,force_n,simulated"]
    for (texture, speed, force), samples in signals.items():
        name = f"{texture}_{speed:g}_{force:g}.wav"
        made.write_float_wav(folder / name, samples, 5000)
        lines.append(f"{name},{texture},{speed},{force},true")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="session")
def arrays(signals) -> list[sh.Recording]:
    """The same samples as recordings in memory."""
    return [
        sh.Recording(samples, 5000, texture=texture, speed_mm_s=speed, force_n=force, simulated=True)
        for (texture, speed, force), samples in signals.items()
    ]


@pytest.fixture(scope="session")
def fitted(folder: Path) -> sh.Fit:
    return sh.fit(folder)


@pytest.fixture(scope="session")
def command(folder: Path) -> Command:
    """The command in a folder with `a.lib`, which it has fitted to the recordings."""
    command = Command(folder)
    command.succeed("fit", folder, "--out", "a.lib")
    return command


@pytest.fixture
def stylus():
    """The link of a fake stylus."""
    pipe = subprocess.PIPE
    with subprocess.Popen([needed("STYLUS_FAKE")], stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout and process.stdin
        yield process.stdout.readline().strip()
        process.stdin.close()


@pytest.fixture
def attached(stylus: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The link of a fake stylus that is announced, as a virtual one announces itself: in a file that it locks."""
    folder = tmp_path / "run" / "stylus"
    folder.mkdir(parents=True)
    for one in (folder.parent, folder):
        one.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder.parent))
    with open(folder / "virtual-1-0", "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        # Its virtual time, then its link.
        file.write(f"0\n{stylus}\n")
        file.flush()
        yield stylus
