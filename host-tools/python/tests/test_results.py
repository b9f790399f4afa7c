"""Results outlive the program: pickles, tables, and what a notebook shows."""

import base64
import io
import pickle
import re
import subprocess
import sys
import wave

import numpy as np
import pytest
import stylus_haptics as sh

import made


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def test_results_survive_a_pickle(fitted, folder, tmp_path):
    library = again(fitted.library)
    assert library == fitted.library and library.record() == fitted.record()
    # With its record, the library still knows what is held out.
    found = sh.evaluate(folder, library)
    assert found.held_out.startswith("fitted on every other block")
    assert again(found).as_dict() == found.as_dict() and repr(again(found)) == repr(found)
    fit = again(fitted)
    assert fit.library == fitted.library and fit.trials == fitted.trials and fit.warnings == fitted.warnings
    played = sh.render(fit, "felt", speed_mm_s=120, force_n=0.8, seconds=1)
    copied = again(played)
    for name in ("samples", "words"):
        assert np.array_equal(getattr(copied, name), getattr(played, name))
    copied.save(tmp_path / "a.wav")
    assert np.array_equal(made.read_float_wav(tmp_path / "a.wav")[1], played.samples)
    node = again(fit.library["cork"]).node(1, 0)
    assert np.array_equal(node.predictor, fitted.library["cork"].node(1, 0).predictor)


def test_a_record_of_another_library_is_refused(fitted, arrays):
    other = sh.fit(arrays[:4], order=3)
    _, (_, record) = other.library.__reduce__()
    with pytest.raises(sh.StylusError, match="another library"):
        sh.Library(bytes(fitted.library), record)


def test_a_rendering_plays_in_a_notebook_with_its_label_and_its_origin(fitted, arrays):
    played = sh.render(fitted, "felt", speed_mm_s=120, force_n=0.8, seconds=12)
    shown = played._repr_html_()
    assert "felt" in shown and "SIMULATED" in shown and "first 10 of 12 s" in shown
    data = base64.b64decode(re.search(r'src="data:audio/wav;base64,([^"]+)"', shown).group(1))
    with wave.open(io.BytesIO(data)) as file:
        assert (file.getframerate(), file.getnchannels(), file.getnframes()) == (20_000, 1, 200_000)
        heard = np.frombuffer(file.readframes(200_000), "<i2").astype(float)
    # Every fourth sample is one of the rendering, scaled to its peak.
    samples = played.samples[:50_000].astype(float)
    assert np.allclose(heard[::4] / 32767, 0.9 * samples / np.abs(samples).max(), atol=1e-4)
    measured = [sh.Recording(one.samples(), 5000, texture="<b>", speed_mm_s=one.speed_mm_s) for one in arrays[:4:2]]
    shown = sh.render(sh.fit(measured), "<b>", speed_mm_s=100, force_n=1, seconds=1)._repr_html_()
    assert "SIMULATED" not in shown and "<b>" not in shown and "&lt;b&gt;" in shown


def test_results_are_tables(fitted, folder):
    found = sh.evaluate(folder, fitted)
    table = found.to_dataframe()
    assert len(table) == len(found) == 8 and list(table["texture"]).count("felt") == 4
    assert np.array_equal(table["cost"].to_numpy(float), found.cost) and "other.cost" in table
    trials = fitted.to_dataframe()
    assert list(trials["rms_m_s2"]) == [trial.rms_m_s2 for trial in fitted.trials]
    nodes = fitted.library["felt"].to_dataframe()
    assert list(nodes["order"]) == fitted.library["felt"].orders.ravel().tolist()
    assert found._repr_html_().count("<tr>") == 3 and "SIMULATED" in found._repr_html_()


def test_a_table_without_pandas_says_what_to_install():
    code = (
        "import sys; sys.modules['pandas'] = None\n"
        "from stylus_haptics import Fit\n"
        "Fit(None, [], []).to_dataframe()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1 and "ImportError: to_dataframe needs pandas: pip install pandas" in done.stderr
