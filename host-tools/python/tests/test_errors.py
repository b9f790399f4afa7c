"""Failures are exceptions with the command's one line, and doubts are warnings."""

import array
import resource

import numpy as np
import pytest
import stylus_haptics as sh


def raised(function, *arguments, **keywords) -> sh.StylusError:
    with pytest.raises(sh.StylusError) as caught:
        function(*arguments, **keywords)
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_bad_line_of_a_list_is_the_commands_line_with_its_place(command, tmp_path):
    (tmp_path / "trials.csv").write_text("file,texture,speed_mm_s,force_n\na.wav,felt,fast,1\n")
    error = raised(sh.fit, tmp_path)
    assert str(error) == command.refuse("fit", tmp_path, "--out", "x.lib")
    assert (error.kind, error.path, error.line) == ("line", tmp_path / "trials.csv", 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda d: sh.fit(d / "nowhere"), ["fit", "nowhere", "--out", "x.lib"]),
        (lambda d: sh.render(d / "no.lib", "felt", speed_mm_s=1, force_n=1, seconds=1), None),
        (lambda d: sh.Library.open(d / "bad.lib"), ["inspect", "bad.lib"]),
        (
            lambda d: sh.render(d / "a.lib", "silk", speed_mm_s=1, force_n=1, seconds=1),
            ["render", "a.lib", "--texture", "silk", "--speed", 1, "--force", 1, "--seconds", 1, "--out", "x.wav"],
        ),
        (
            lambda d: sh.render(d / "a.lib", "felt", motion=d / "bad.csv"),
            ["render", "a.lib", "--texture", "felt", "--motion", "bad.csv", "--out", "x.wav"],
        ),
    ],
)
def test_other_failures_are_the_commands_line(command, folder, call, words):
    (folder / "bad.lib").write_bytes(b"no library")
    (folder / "bad.csv").write_text("time_s,speed_mm_s,force_n\n0,0,1\n0,1,1\n")
    error = raised(call, folder)
    assert error.kind in ("io", "library", "request", "line")
    if words is not None:
        said = command.refuse(*words)
        # The command was given names within its folder.
        assert str(error).replace(f"{folder}/", "") == said


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda s: sh.Recording(s, 5000, texture=""), "no name"),
        (lambda s: sh.Recording(s, 5000, texture="felt", speed_mm_s=-1), "speed_mm_s"),
        (lambda s: sh.Recording(s, 5000, texture="felt", force_n=1e6), "newtons"),
        (lambda s: sh.Recording(s, 5, texture="felt"), "rate"),
        (lambda s: sh.Recording(s, 5000, texture="felt", scale_m_s2=0), "scale_m_s2"),
        (lambda s: sh.Recording(s, 5000, texture="felt", duration_s=0), "duration_s"),
        (lambda s: sh.Recording(np.zeros((3, 900)), 5000, texture="felt"), "transpose"),
        (lambda s: sh.Recording(np.zeros((9, 9)), 5000, texture="felt"), "shape"),
        (lambda s: sh.Recording(np.zeros(9, complex), 5000, texture="felt"), "float32"),
        (lambda s: sh.Recording(np.zeros(0), 5000, texture="felt"), "none"),
        (lambda s: sh.Recording(np.ma.masked_greater(s, 0), 5000, texture="felt"), "masked"),
        (lambda s: sh.Recording(np.broadcast_to(s[0], 2**40), 5000, texture="felt"), "at most"),
        (lambda s: sh.fit([]), "no recordings"),
        (lambda s: sh.fit(3), "no set"),
        (lambda s: sh.fit([sh.Recording(s, 5000, texture="felt"), "a.wav"]), "together"),
        (lambda s: sh.fit("x", order="best"), "'bic'"),
        (lambda s: sh.fit("x", order=401), "400"),
        (lambda s: sh.fit("x", drop=["loud"]), "clipped"),
        (lambda s: sh.fit("x", snap=0.5), "0.25"),
        (lambda s: sh.fit("x", snap="clearly"), "clear, auto or none"),
        (lambda s: sh.Recordings("x", time_unit="min"), "'ms'"),
        (lambda s: sh.fit("x", model_rate_hz=8000), "8000"),
        (lambda s: sh.Motion([0, 1, 1], 1, 1), "row 3"),
        (lambda s: sh.Motion([0, 1], [1, 2, 3], 1), "speed_mm_s"),
        (lambda s: sh.Motion([0, 1], 1e9, 1), "mm/s"),
        (lambda s: sh.Motion([], 1, 1), "at least one row"),
        (lambda s: sh.Motion([0, 1], np.ma.masked_less(s[:2], 2), 1), "speed_mm_s has masked"),
        (lambda s: sh.fit_strokes("a.csv", "x" * 49), "49 bytes"),
        (lambda s: sh.Library(b"no library"), "library"),
        (lambda s: sh.Device("carrier pigeon"), "link"),
        (lambda s: sh.Device("tcp:127.0.0.1:1"), "nothing listens"),
    ],
)
def test_what_cannot_be_used_is_named_with_the_remedy(call, word):
    assert word in str(raised(call, np.ones(5000)))


class Liar:
    """A sequence of other values than its length says."""

    def __init__(self, says: int, holds: int):
        self.says, self.holds = says, holds

    def __len__(self):
        return self.says

    def __getitem__(self, index):
        if index >= self.holds:
            raise IndexError
        return float(index)


class LyingList(list):
    def __len__(self):
        return 10**18


HUGE = 10**10
NESTED = [
    np.broadcast_to(np.int8(1), (HUGE,)),
    np.broadcast_to(np.float32(1), (HUGE,)),
    np.ma.masked_array(np.broadcast_to(np.float32(1), (HUGE,)), False),
    range(10**11),
    Liar(10**18, 3),
    Liar(10**6, 3),
    Liar(3, 10**18),
    LyingList([0.0, 1.0]),
    [0.0, range(10**11)],
    [Liar(10**18, 1)] * 3,
]


@pytest.mark.parametrize("values", NESTED, ids=range(len(NESTED)))
@pytest.mark.parametrize(
    "door",
    [
        lambda v: sh.Motion(v, 1.0, 1.0),
        lambda v: sh.Motion([0.0, 1.0], v, 1.0),
        lambda v: sh.Motion([0.0, 1.0], 1.0, v),
        lambda v: sh.Motion([0.0, 1.0], 1.0, 1.0, position_mm=v),
        lambda v: sh.Motion([0.0, 1.0], 1.0, 1.0, contact=v),
        lambda v: sh.Recording(v, 5000, texture="felt"),
    ],
)
def test_no_length_of_an_array_is_believed_at_any_door(door, values):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises((sh.StylusError, TypeError)):
        door(values)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize(
    "door",
    [
        lambda v: sh.fit(v),
        lambda v: sh.fit("x", drop=v),
        lambda v: sh.compare("x", "a.lib", "out.html", pairs=v),
        lambda v: sh.score(v),
        lambda v: sh.fit_strokes(v, "felt"),
    ],
)
@pytest.mark.parametrize("values", [LyingList([1.0]), range(10**11)], ids=["a list", "a range"])
def test_no_length_of_a_list_is_believed_at_any_door(door, values):
    with pytest.raises((sh.StylusError, TypeError)):
        door(values)


def test_arrays_of_every_kind_that_numpy_takes_are_taken():
    times, ones = [0.0, 0.5, 2.0], [1.0, 1.0, 1.0]
    of_numpy = [np.float32(time) for time in times]
    for values in (times, tuple(times), np.array(times, "f4"), array.array("d", times), of_numpy, Liar(3, 3)):
        assert sh.Motion(values, ones, 1).duration_s == 2.0
    rows = np.random.default_rng(1).standard_normal((900, 2))
    for values in (rows, rows.tolist(), list(rows), memoryview(rows)):
        taken = sh.Recording(values, 5000, texture="felt").samples()
        assert np.allclose(taken, rows)


def test_an_input_is_never_the_output(fitted, folder, tmp_path):
    fitted.save(tmp_path / "a.lib")
    for library in (tmp_path / "a.lib", sh.Library.open(tmp_path / "a.lib")):
        for call in (
            lambda out: sh.page(library, out, overwrite=True),
            lambda out: sh.page(library, out, recordings=folder, overwrite=True),
            lambda out: sh.compare(folder, library, out, overwrite=True),
        ):
            for out in (tmp_path / "a.lib", tmp_path / "a.lib.fit.json"):
                assert "is an input" in str(raised(call, out))
    for out in (folder / "trials.csv", next(folder.glob("*.wav"))):
        assert "is an input" in str(raised(sh.compare, folder, tmp_path / "a.lib", out, overwrite=True))
    error = raised(sh.evaluate, folder, tmp_path / "a.lib", report=tmp_path, overwrite=True)
    assert "holds an input" in str(error)


def test_samples_that_are_no_numbers_are_named(arrays):
    samples = np.random.default_rng(3).standard_normal(9000)
    samples[1234] = np.nan
    error = raised(sh.fit, sh.Recording(samples, 5000, texture="felt"))
    assert "sample 1234 of channel 1" in str(error)


def test_a_texture_needs_a_motion_with_an_end(fitted):
    for keywords in (
        {},
        {"speed_mm_s": 1},
        {"speed_mm_s": 1, "force_n": 1},
        {"motion": sh.Motion.constant(1, 1), "speed_mm_s": 1, "force_n": 1},
        {"speed_mm_s": 1, "force_n": 1, "seconds": -1},
        {"speed_mm_s": 1, "force_n": 1, "seconds": float("nan")},
    ):
        raised(sh.render, fitted, "felt", **keywords)


def test_what_is_there_is_replaced_only_on_request(fitted, tmp_path):
    path = tmp_path / "diary"
    path.write_text("today\n")
    assert raised(fitted.save, path).path == path
    played = sh.render(fitted, "felt", speed_mm_s=100, force_n=1, seconds=1)
    assert raised(played.save, path).path == path
    assert path.read_text() == "today\n"
    played.save(path, overwrite=True)
    assert path.read_bytes()[:4] == b"RIFF"


def test_doubts_are_warnings(signals, fitted):
    counts = np.round(signals["cork", 80.0, 0.5] * 2000).astype(np.int16)
    with pytest.warns(sh.StylusWarning, match="without a unit"):
        fit = sh.fit(sh.Recording(counts, 5000, texture="cork"))
    assert any("without a unit" in warning for warning in fit.warnings)
    with pytest.warns(sh.StylusWarning, match="nothing is heard"):
        sh.render(fitted, "felt", speed_mm_s=100, force_n=0, seconds=1)


def test_what_python_raises_has_the_attributes_too():
    error = sh.StylusError("mine")
    assert (error.kind, error.path, error.line) == ("request", None, None)
