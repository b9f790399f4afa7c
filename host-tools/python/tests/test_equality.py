"""The same input gives the same bits as the command."""

import json
import wave

import numpy as np
import pytest
import stylus_haptics as sh

import made


def judges(found):
    return {trial["judge"] for trial in found.as_dict()["trials"]}


def test_a_fit_of_a_folder_is_the_commands_library_and_record_byte_for_byte(command, fitted, folder, tmp_path):
    assert bytes(fitted.library) == (folder / "a.lib").read_bytes()
    fitted.save(tmp_path / "b.lib")
    assert (tmp_path / "b.lib").read_bytes() == (folder / "a.lib").read_bytes()
    record = (folder / "a.lib.fit.json").read_text()
    assert (tmp_path / "b.lib.fit.json").read_text() == record
    assert fitted.record() == json.loads(record)


def test_a_fit_of_arrays_is_that_of_their_files(arrays, fitted):
    of_arrays = sh.fit(arrays)
    assert of_arrays.library == fitted.library
    reports = [[t.rms_m_s2, t.energy_share, t.seconds, t.verdicts, t.used] for t in of_arrays.trials]
    assert reports == [[t.rms_m_s2, t.energy_share, t.seconds, t.verdicts, t.used] for t in fitted.trials]


def test_integers_in_memory_are_those_of_a_wav_file(signals, tmp_path):
    samples = np.round(signals["cork", 160.0, 1.0] * 2000).astype(np.int16)
    with wave.open(str(tmp_path / "cork.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(5000)
        file.writeframes(samples.tobytes())
    given = {"texture": "cork", "scale_m_s2": 98.1, "speed_mm_s": 160.0, "force_n": 1.0}
    of_file = sh.Recording.from_file(tmp_path / "cork.wav", **given)
    in_memory = sh.Recording(samples, 5000, **given)
    assert np.array_equal(of_file.samples(), in_memory.samples())
    assert sh.fit(of_file).library == sh.fit(in_memory).library


@pytest.mark.parametrize(
    ("words", "keywords"),
    [
        (["--order", "40"], {"order": 40}),
        (["--order", "bic", "--reduce", "dft321"], {"order": "bic", "reduce": "dft321"}),
        (
            ["--excitation", "gaussian", "--modulation", "none", "--lines", "none"],
            {"excitation": "gaussian", "modulation": "none", "lines": "none"},
        ),
        (["--excitation", "residual", "--modulation", "track"], {"excitation": "residual", "modulation": "track"}),
    ],
)
def test_options_mean_what_they_mean_on_the_command_line(command, folder, words, keywords):
    command.succeed("fit", folder, "--out", "options.lib", "--overwrite", *words)
    assert bytes(sh.fit(folder, **keywords).library) == (folder / "options.lib").read_bytes()


def test_a_rendering_is_the_commands_sample_for_sample(command, fitted, folder):
    words = ["--speed", 130, "--force", 0.8, "--seconds", 3, "--seed", 7]
    command.succeed("render", "a.lib", "--texture", "felt", *words, "--out", "felt.wav")
    rate_hz, expected = made.read_float_wav(folder / "felt.wav")
    played = sh.render(fitted, "felt", speed_mm_s=130, force_n=0.8, seconds=3, seed=7)
    assert (played.sample_rate_hz, len(played)) == (rate_hz, 15000)
    assert played.samples.dtype == np.float32
    assert np.array_equal(played.samples, expected) and expected.std() > 0.01
    assert np.array_equal((played.words / 2.0**20).astype(np.float32), expected)
    played.save(folder / "again.wav")
    assert (folder / "again.wav").read_bytes() == (folder / "felt.wav").read_bytes()


def test_a_motion_of_arrays_is_that_of_its_table(command, fitted, folder):
    time_s = np.linspace(0, 2, 41)
    speed_mm_s = np.round(120 * np.sin(np.pi * time_s), 3)
    force_n = np.round(0.7 + 0.3 * np.cos(3 * time_s), 3)
    rows = [f"{t},{v},{f}" for t, v, f in zip(time_s, speed_mm_s, force_n)]
    (folder / "motion.csv").write_text("\n".join(["time_s,speed_mm_s,force_n", *rows]) + "\n")
    command.succeed("render", "a.lib", "--texture", "cork", "--motion", "motion.csv", "--out", "moved.wav")
    _, expected = made.read_float_wav(folder / "moved.wav")
    file = folder / "motion.csv"
    for motion in (sh.Motion(time_s, speed_mm_s, force_n), sh.Motion.read(file), file):
        assert np.array_equal(sh.render(fitted, "cork", motion=motion).samples, expected)


def test_an_evaluation_has_the_commands_figures(command, fitted, folder):
    command.succeed("evaluate", folder, "--library", "a.lib", "--json-out", "figures.json")
    expected = json.loads((folder / "figures.json").read_text())
    found = sh.evaluate(folder, fitted)
    assert found.as_dict() == expected
    assert sh.evaluate(folder, folder / "a.lib").as_dict() == expected
    costs = [trial["cost"] for trial in expected["trials"]]
    assert np.array_equal(found.cost, np.array(costs, float), equal_nan=True)
    assert judges(found) == {"blocks"} and found.simulated
    assert found.band_errors_db.shape == (len(found), len(found.bands_hz))


def test_an_evaluation_of_arrays_is_judged_by_blocks_too(arrays, fitted, folder):
    of_arrays = sh.evaluate(arrays, sh.fit(arrays))
    of_files = sh.evaluate(folder, fitted)
    assert judges(of_arrays) == {"blocks"}
    assert np.array_equal(of_arrays.cost, of_files.cost, equal_nan=True)


def test_takes_judge_the_library_and_a_take_that_was_fitted_does_not(signals, fitted, folder):
    takes = [
        sh.Recording(
            made.recording(texture + " again", 3 if texture == "felt" else 1, speed, force),
            5000,
            texture=texture,
            speed_mm_s=speed,
            force_n=force,
        )
        for texture, speed, force in signals
    ]
    assert judges(sh.evaluate(folder, fitted, takes=takes)) == {"other_take"}
    with pytest.warns(sh.StylusWarning, match="judges nothing"):
        seen = sh.evaluate(folder, fitted, takes=folder)
    assert judges(seen) == {"blocks"}


def test_what_is_in_a_library_is_the_commands(command, fitted):
    assert sh.inspect(fitted) == command.json("inspect", "a.lib", "--json")


SCENE = """
name = "two mats"
transition_mm = 4
[[surface]]
texture = "felt"
[[surface]]
texture = "cork"
[surface.tap]
frequency_hz = 240
decay_s = 0.012
gain_m_s2_per_n_s = 0.4
limit_m_s2 = 40
[[region]]
surface = "felt"
start_mm = 0
end_mm = 100
[[region]]
surface = "cork"
start_mm = 100
end_mm = 300
"""


def test_scenes_compile_cost_and_play_as_the_commands_do(command, fitted, folder):
    (folder / "mats.toml").write_text(SCENE)
    command.succeed("scene", "compile", "mats.toml", "--library", "a.lib", "--out", "scenes.lib", "--overwrite")
    scene = sh.compile_scene(folder / "mats.toml", fitted)
    library = fitted.library.with_scenes([scene])
    assert bytes(library) == (folder / "scenes.lib").read_bytes()
    checked = command.json("scene", "check", "mats.toml", "--library", "a.lib", "--json")
    assert scene.cost() == {key: value for key, value in checked.items() if key != "equaliser"}
    words = ["--speed", 100, "--force", 0.8, "--seconds", 2]
    command.succeed("scene", "render", "scenes.lib", *words, "--out", "scene.wav")
    _, expected = made.read_float_wav(folder / "scene.wav")
    for one in (scene, library.scene(), library.scenes[0], sh.compile_scene(SCENE, library)):
        assert np.array_equal(one.render(speed_mm_s=100, force_n=0.8, seconds=2).samples, expected)


def test_simulated_recordings_are_the_commands(command, folder, tmp_path):
    rig = sh.paper_rig()
    assert rig.rstrip() == command.succeed("simulate-rig", "--print-rig").rstrip()
    for name in ("speeds_mm_s", "forces_n"):
        line = next(line for line in rig.splitlines() if line.startswith(f"{name} ="))
        rig = rig.replace(line, f"{name} = [{'80, 160' if name == 'speeds_mm_s' else '0.4, 1.0'}]")
    (tmp_path / "rig.toml").write_text(rig)
    command.succeed("simulate-rig", "--rig", tmp_path / "rig.toml", "--seed", 3, "--out", tmp_path / "command")
    found = sh.simulate_rig(tmp_path / "python", rig=rig, seed=3)
    assert len(found) == 16 and all(recording.simulated for recording in found)
    files = sorted(path.relative_to(tmp_path / "command") for path in (tmp_path / "command").rglob("*.*"))
    assert len(files) > 16
    for file in files:
        assert (tmp_path / "python" / file).read_bytes() == (tmp_path / "command" / file).read_bytes(), file


def test_hatts_models_become_the_commands_library(command, folder):
    (folder / "Models_cork.xml").write_text(made.hatt_models())
    report = command.json("import-hatt", "Models_cork.xml", "--out", "hatt.lib", "--overwrite", "--json")
    found = sh.import_hatt(folder / "Models_cork.xml")
    assert bytes(found.library) == (folder / "hatt.lib").read_bytes()
    assert found.as_dict() == report
