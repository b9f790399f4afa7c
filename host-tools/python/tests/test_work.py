"""Long work: progress, the interpreter's lock, Ctrl-C; and results that are NumPy arrays."""

import threading

import numpy as np
import pytest
import stylus_haptics as sh


def test_progress_rises_to_the_number_of_recordings(folder, fitted):
    told = []
    sh.evaluate(folder, fitted, progress=lambda done, total: told.append((done, total)))
    assert told == sorted(told) and told[-1] == (8, 8)


def test_what_progress_raises_ends_the_work(fitted):
    told = []

    def refuse(done, total):
        told.append(done < total)
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        sh.render(fitted, "felt", speed_mm_s=100, force_n=1, seconds=6000, progress=refuse)
    assert told == [True]


def test_other_threads_run_while_a_texture_is_rendered(fitted):
    beats, done, told = [], threading.Event(), []

    def beat():
        while not done.wait(0.005):
            beats.append(None)

    def tell(*_):
        told.append(len(beats))

    thread = threading.Thread(target=beat)
    thread.start()
    for _ in range(100):
        # This thread runs nothing of Python between two calls of `tell`.
        told.clear()
        sh.render(fitted, "felt", speed_mm_s=100, force_n=1, seconds=300, progress=tell)
        if told[-1] > told[0]:
            break
    done.set()
    thread.join()
    assert told[-1] > told[0]


def test_ctrl_c_ends_a_rendering_of_hours(fitted, ctrl_c):
    told = []

    def tell(done, total):
        told.append(done < total)
        ctrl_c.set()

    with pytest.raises(KeyboardInterrupt):
        sh.render(fitted, "felt", speed_mm_s=100, force_n=1, seconds=6000, progress=tell)
    assert all(told)


def test_ctrl_c_ends_a_fit(arrays, ctrl_c):
    with pytest.raises(KeyboardInterrupt):
        ctrl_c.set()
        for _ in range(1000):
            sh.fit(arrays)


def test_an_array_may_change_once_it_is_a_recording():
    samples = np.random.default_rng(1).standard_normal(5000)
    recording = sh.Recording(samples, 5000, texture="felt")
    before = recording.samples()
    samples[:] = 0
    assert np.array_equal(recording.samples(), before)


def test_samples_are_read_at_the_models_rate_in_m_s2_from_the_cut_on():
    samples = np.arange(10000.0)
    recording = sh.Recording(samples, 5000, texture="felt", scale_m_s2=2.0, start_s=0.5, duration_s=0.1)
    assert np.array_equal(recording.samples()[:, 0], 2.0 * samples[2500:3000])


def test_the_signal_of_a_recording_is_what_a_fit_takes_of_it(arrays, fitted):
    for recording, trial in zip(arrays, fitted.trials):
        signal = recording.signal()
        assert abs(signal.mean()) < 1e-9 and np.isclose(signal.std(), trial.rms_m_s2, rtol=1e-9)
        axes = recording.samples() - recording.samples().mean(axis=0)
        # The first principal component has the largest variance of all directions.
        assert np.isclose(signal.var(), np.linalg.eigvalsh(np.cov(axes.T, bias=True).reshape(axes.shape[1], -1))[-1])
        assert np.allclose(recording.signal(reduce="x"), axes[:, 0])


def test_columns_of_any_layout_are_axes():
    axes = np.random.default_rng(2).standard_normal((3, 4000))
    for samples in (axes.T, np.ascontiguousarray(axes.T), axes.T.astype(np.float32).astype(float), axes.T.tolist()):
        found = sh.Recording(samples, 5000, texture="felt").samples()
        assert found.shape == (4000, 3) and np.allclose(found, axes.T, atol=1e-6)


def test_grids_are_arrays_over_speeds_and_forces(fitted):
    texture = fitted.library["felt"]
    assert texture.speeds_mm_s.tolist() == [80, 160] and texture.forces_n.tolist() == [0.5, 1]
    for grid in (texture.orders, texture.rms_m_s2, texture.filled, texture.silent, texture.doubtful):
        assert grid.shape == (2, 2)
    node = texture.node(1, 0)
    assert (node.speed_mm_s, node.force_n) == (160, 0.5)
    assert node.order == texture.orders[1, 0] == len(node.predictor) == len(node.reflection)
    assert node.rms_m_s2 == texture.rms_m_s2[1, 0]
    assert np.all(np.abs(node.reflection) < 1)


def test_a_nodes_spectrum_is_that_of_what_is_played_there(arrays):
    fit = sh.fit(arrays, order=12, excitation="gaussian", lines="none")
    played = sh.render(fit, "cork", speed_mm_s=160, force_n=1, seconds=60).samples[5000:].astype(float)
    length = 1000
    pieces = played[: len(played) // length * length].reshape(-1, length) * np.hanning(length)
    density = 2 * np.mean(np.abs(np.fft.rfft(pieces)) ** 2, axis=0) / (5000 * np.sum(np.hanning(length) ** 2))
    frequencies = np.fft.rfftfreq(length, 1 / 5000)
    band = (frequencies > 30) & (frequencies < 1000)
    model = fit.library["cork"].node(1, 1).spectrum(frequencies)
    assert np.median(np.abs(10 * np.log10(density[band] / model[band]))) < 0.7
    # The density's integral is the variance.
    dense = np.linspace(0, 2500, 200_001)
    variance = np.trapezoid(fit.library["cork"].node(1, 1).spectrum(dense), dense)
    assert np.isclose(variance, fit.library["cork"].node(1, 1).rms_m_s2 ** 2, rtol=0.02)


def test_a_spectrum_of_more_frequencies_than_memory_holds_is_refused(fitted):
    node = fitted.library["felt"].node(0, 0)
    with pytest.raises(sh.StylusError, match="frequencies_hz has 1099511627776 values"):
        node.spectrum(np.broadcast_to(1.0, 2**40))


def test_a_name_that_turns_text_around_is_shown_by_its_number(signals):
    recordings = [
        sh.Recording(samples, 5000, texture="felt\u202e", speed_mm_s=speed, force_n=force)
        for (texture, speed, force), samples in signals.items()
        if texture == "felt"
    ]
    assert "\u202e" not in repr(sh.fit(recordings))


def test_a_library_is_a_mapping_that_survives_bytes_and_files(fitted, tmp_path):
    library = fitted.library
    assert list(library) == library.keys() == ["felt", "cork"] and len(library) == 2
    assert "felt" in library and "silk" not in library and library["felt"].simulated
    with pytest.raises(KeyError):
        library["silk"]
    again = sh.Library(bytes(library))
    assert again == library and hash(again) == hash(library) and again != bytes(library)
    library.save(tmp_path / "a.lib")
    assert sh.Library.open(tmp_path / "a.lib") == library
