"""Pages and pieces that are written: the same bytes as the command's."""

import re

import numpy as np
import pytest
import stylus_haptics as sh


def test_a_page_to_rub_is_the_commands(command, fitted, folder, tmp_path):
    told = command.succeed("page", "a.lib", "--out", tmp_path / "a.html")
    digests = sh.page(fitted, tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert list(digests) == ["felt", "cork"] and all(digest in told for digest in digests.values())
    command.succeed("page", folder, "--out", tmp_path / "c.html", "--clips", "0.5", "--seed", "3")
    counted = []
    sh.page(
        fitted, tmp_path / "d.html", recordings=folder, clips_s=0.5, seed=3, progress=lambda *at: counted.append(at)
    )
    assert (tmp_path / "c.html").read_bytes() == (tmp_path / "d.html").read_bytes()
    assert counted[-1] == (8, 8)
    with pytest.raises(sh.StylusError, match="overwrite=True"):
        sh.page(fitted, tmp_path / "d.html")


def test_a_report_is_the_commands_and_brings_its_figures(command, fitted, folder, tmp_path):
    of_command, of_python = tmp_path / "a", tmp_path / "b"
    command.succeed("evaluate", folder, "--library", "a.lib", "--report", of_command)
    found = sh.report(folder, fitted, of_python)
    names = sorted(path.relative_to(of_command) for path in of_command.rglob("*"))
    assert names == sorted(path.relative_to(of_python) for path in of_python.rglob("*")) and len(names) > 3
    for name in names:
        assert (of_command / name).read_bytes() == (of_python / name).read_bytes(), name
    assert found.as_dict() == sh.evaluate(folder, fitted).as_dict()
    with pytest.raises(sh.StylusError, match="overwrite=True"):
        sh.report(folder, fitted, of_python)


def test_a_listening_test_is_the_commands_and_is_scored_as_by_it(command, folder, fitted, tmp_path):
    words = ["--trials", "3", "--segment", "0.3", "--pairs", "recording-gaussian", "--overwrite"]
    pairs = ["recording-gaussian"]
    for design in ("abx", "similarity"):
        asked = [*words, "--design", design, "--out", tmp_path / "a.html"]
        told = command.succeed("compare", folder, "--library", "a.lib", *asked)
        kept = {"design": design, "trials": 3, "segment_s": 0.3, "pairs": pairs, "overwrite": True}
        trials = sh.compare(folder, fitted, tmp_path / "b.html", **kept)
        assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
        assert f" {trials} trials" in told
    for given, word in (
        ({"trials": 0}, "1 to 200"),
        ({"pairs": ["x"]}, "gaussian-fitted"),
        ({"before": fitted}, "takes"),
        ({"design": "staircase", "pairs": pairs}, "leave pairs"),
    ):
        with pytest.raises(sh.StylusError, match=word):
            sh.compare(folder, fitted, tmp_path / "c.html", **given)
    answers = tmp_path / "answers.csv"
    answers.write_text(
        "listener,trial,pair,a,b,x,answer,correct,replays,seconds,page,origin\n"
        "1,1,recording-fitted,recording,fitted,fitted,B,1,0,2.5,p,SIMULATED\n"
        "1,2,recording-fitted,recording,fitted,fitted,A,0,0,2.5,p,SIMULATED\n"
    )
    (pair, *_) = sh.score([answers])
    assert (pair["pair"], pair["trials"], pair["correct"], pair["simulated"]) == ("recording-fitted", 2, 1, True)
    shown = command.succeed("compare", "--score", answers)
    assert re.search(rf"recording-fitted +1 +2 +1 +{100 * pair['proportion']:.1f} %", shown), shown


def strokes(path):
    """Two seconds each at 100 and 200 mm/s and 1 N, with a second of haste between, and a value that no sensor has."""
    speed = np.concatenate([np.full(2000, 100.0), np.linspace(100, 200, 1000), np.full(2000, 200.0)])
    noise = np.random.default_rng(5).standard_normal(len(speed))
    noise[2500] = 9999
    rows = [f"{n / 1000:.3f},{v},1,{a:.5f}" for n, (v, a) in enumerate(zip(speed, noise))]
    path.write_text("# SIMULATED\ntime_s,speed_mm_s,force_n,x_m_s2\n" + "\n".join(rows) + "\n")


def test_strokes_are_fitted_and_shown_as_by_the_command(command, tmp_path):
    strokes(tmp_path / "hand.csv")
    words = [tmp_path / "hand.csv", "--strokes", "--texture", "felt"]
    command.succeed("fit", *words, "--out", tmp_path / "felt.lib")
    with pytest.warns(sh.StylusWarning, match="line 2503: x_m_s2 is 9999"):
        fit = sh.fit_strokes(tmp_path / "hand.csv", "felt")
    fit.save(tmp_path / "own.lib")
    for name in ["{}.lib", "{}.lib.fit.json"]:
        own, told = [(tmp_path / name.format(by)).read_bytes() for by in ("own", "felt")]
        assert own == told, name
    command.succeed("page", *words, "--out", tmp_path / "fitted.html")
    command.succeed("page", tmp_path / "felt.lib", "--out", tmp_path / "shown.html")
    assert (tmp_path / "fitted.html").read_bytes() == (tmp_path / "shown.html").read_bytes()
    with pytest.raises(sh.StylusError, match="empty"):
        sh.fit_strokes(tmp_path / "hand.csv", "")
