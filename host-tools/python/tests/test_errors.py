"""Failures are exceptions with the command's one line, and doubts are warnings."""

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
        (lambda s: sh.fit("x", model_rate_hz=8000), "8000"),
        (lambda s: sh.Motion([0, 1, 1], 1, 1), "row 3"),
        (lambda s: sh.Motion([0, 1], [1, 2, 3], 1), "speed_mm_s"),
        (lambda s: sh.Motion([0, 1], 1e9, 1), "mm/s"),
        (lambda s: sh.Motion([], 1, 1), "at least one row"),
        (lambda s: sh.Motion([0, 1], np.ma.masked_less(s[:2], 2), 1), "speed_mm_s has masked"),
        (lambda s: sh.Library(b"no library"), "library"),
        (lambda s: sh.Device("carrier pigeon"), "link"),
        (lambda s: sh.Device("tcp:127.0.0.1:1"), "nothing listens"),
    ],
)
def test_what_cannot_be_used_is_named_with_the_remedy(call, word):
    assert word in str(raised(call, np.ones(5000)))


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
    with pytest.warns(sh.StylusWarning, match="integers"):
        fit = sh.fit(sh.Recording(counts, 5000, texture="cork"))
    assert any("integers" in warning for warning in fit.warnings)
    with pytest.warns(sh.StylusWarning, match="nothing is heard"):
        sh.render(fitted, "felt", speed_mm_s=100, force_n=0, seconds=1)


def test_what_python_raises_has_the_attributes_too():
    error = sh.StylusError("mine")
    assert (error.kind, error.path, error.line) == ("request", None, None)
