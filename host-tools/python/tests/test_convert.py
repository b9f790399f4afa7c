"""Conversions write the samples that they read, or say what they did; what they refuse leaves nothing behind."""

from __future__ import annotations

import os
import pickle
import sys
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pytest
import scipy.io
import scipy.io.wavfile
import stylus_haptics as sh
from nptdms import ChannelObject, TdmsWriter
from stylus_haptics.convert import Refusal, convert, names, tree
from stylus_haptics.convert.__main__ import main

G = 9.80665
RATE_HZ = 5000
TIMES = np.arange(2000) / RATE_HZ


def noise(*shape: int, seed: int = 1) -> np.ndarray:
    """Samples with numbers among them that a conversion by text or by another kind would change."""
    values = np.random.default_rng(seed).standard_normal(shape)
    values.reshape(-1)[:5] = [-0.0, 5e-324, 1 / 3, -1e300, np.nextafter(1, 2)]
    return values


def table(path: Path) -> tuple[list[str], np.ndarray]:
    """Names and columns of a CSV, by Python's own numbers."""
    titles, *rows = path.read_text(encoding="utf-8").splitlines()
    return titles.split(","), np.array([[float(field) for field in row.split(",")] for row in rows]).T


def same(found: np.ndarray, expected: np.ndarray) -> bool:
    """Bit for bit."""
    return found.astype("<f8").tobytes() == np.asarray(expected).astype("<f8").tobytes()


def h5(path: Path, **arrays: object) -> None:
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values


def tdms(path: Path, groups: dict[str, dict[str, np.ndarray]], **properties: object) -> None:
    with TdmsWriter(path) as file:
        channels = [ChannelObject(group, name, own, properties) for group, columns in groups.items()
                    for name, own in columns.items()]
        file.write_segment(channels)


def xlsx(path: Path, *rows: list[object]) -> None:
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("log")
    for row in rows:
        sheet.append(row)
    book.save(path)


def hdf(frame: pd.DataFrame, path: Path, is_table: bool = False) -> None:
    """A frame as `to_hdf` of pandas 3 stores it by PyTables, in either of its formats."""
    values, index, titles = frame.to_numpy(), frame.index, list(map(str, frame.columns))
    kind = np.bytes_(index.dtype if index.dtype.kind == "M" else "float")
    stored = index.to_numpy().view("i8") if index.dtype.kind == "M" else index.to_numpy()
    pickled = lambda thing: np.bytes_(pickle.dumps(thing, protocol=0))
    with h5py.File(path, "w") as file:
        group = file.create_group("a")
        group.attrs["pandas_type"] = np.bytes_("frame_table" if is_table else "frame")
        if is_table:
            named = {"index_name": index.name} if index.name else {}
            group.attrs["info"] = pickled({1: {"names": [None]}, "index": named})
            rows = np.zeros(len(frame), [("index", stored.dtype), ("values_block_0", "f8", values.shape[1:])])
            rows["index"], rows["values_block_0"] = stored, values
            group["table"] = rows
            group["table"].attrs.update({"index_kind": kind, "values_block_0_kind": pickled(titles)})
            return
        for name, own in (("axis0", np.bytes_(titles)), ("axis1", stored), ("block0_items", np.bytes_(titles)),
                          ("block0_values", values)):
            group[name] = own
        group["axis1"].attrs.update({"kind": kind, "name": np.bytes_(index.name or "N.")})


def columns(samples: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(("ax", "ay", "az"), samples.T))


#: Writes three axes of samples with what tells their rate, by the usual library.
WRITERS = {
    "matrix.mat": lambda path, x: scipy.io.savemat(path, {"acc": x, "fs": float(RATE_HZ)}),
    "packed.mat": lambda path, x: scipy.io.savemat(path, {"acc": x.T, "dt": 1 / RATE_HZ}, do_compression=True),
    "vectors.mat": lambda path, x: scipy.io.savemat(path, {"t": TIMES, **columns(x)}, oned_as="column"),
    "nested.mat": lambda path, x: scipy.io.savemat(path, {"run": {"log": {"acc": x, "t": TIMES}, "note": "felt"}}),
    "time_first.mat": lambda path, x: scipy.io.savemat(path, {"log": np.column_stack([TIMES, x])}),
    "plain.h5": lambda path, x: h5(path, **{"run/acc": x, "run/fs": RATE_HZ}),
    "transposed.hdf5": lambda path, x: h5(path, accel=x.T, sample_rate=RATE_HZ),
    "fixed.h5": lambda path, x: hdf(pd.DataFrame(columns(x), index=pd.Index(TIMES, name="time_s")), path),
    "table.h5": lambda path, x: hdf(pd.DataFrame({"t": TIMES, **columns(x)}), path, is_table=True),
    "named.h5": lambda path, x: hdf(
        pd.DataFrame(columns(x), index=pd.Index(TIMES, name="time_s")), path, is_table=True),
    "record.npy": lambda path, x: np.save(path, np.rec.fromarrays([TIMES, *x.T], names="t,ax,ay,az")),
    "arrays.npz": lambda path, x: np.savez_compressed(path, acc=x, fs=RATE_HZ),
    "log.tdms": lambda path, x: tdms(path, {"log": columns(x)}, wf_increment=1 / RATE_HZ),
    "frame.parquet": lambda path, x: pd.DataFrame({"time_s": TIMES, **columns(x)}).to_parquet(path),
    "index.parquet": lambda path, x: pd.DataFrame(columns(x), index=pd.Index(TIMES, name="time_s")).to_parquet(path),
    "sheet.xlsx": lambda path, x: xlsx(path, ["Time", "X", "Y", "Z"], ["s", "g", "g", "g"],
                                       *np.column_stack([TIMES, x]).tolist()),
}


def matlab_73(path: Path, x: np.ndarray) -> None:
    """A struct of MATLAB 7.3, with its header of 512 bytes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file["log/acc"], file["log/fs"] = x.T, [[float(RATE_HZ)]]
        file["log"].attrs["MATLAB_class"] = np.bytes_("struct")
        for name in ("acc", "fs"):
            file[f"log/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


WRITERS["struct73.mat"] = matlab_73


@pytest.mark.parametrize("file", WRITERS)
@pytest.mark.parametrize("wav", [False, True])
def test_each_array_that_is_written_is_the_one_that_was_read(file, wav, tmp_path):
    samples = noise(len(TIMES), 3)
    if file.endswith("xlsx"):
        # openpyxl writes 16 digits, and -0 as an integer.
        samples = np.array([[float(f"{own:.15g}") + 0.0 for own in row] for row in samples])
    WRITERS[file](tmp_path / file, samples)
    if wav:
        # Times and a WAV's rate are two things.
        done = convert([tmp_path / file], tmp_path / "out", wav=True, rate_hz=RATE_HZ)
        rate, found = scipy.io.wavfile.read(done.files[0])
        assert rate == RATE_HZ and found.dtype == np.float64 and same(found, samples), done
    else:
        done = convert([tmp_path / file], tmp_path / "out")
        titles, found = table(done.files[0])
        assert len(titles) == 4 and titles[0] == "time_s" or titles[0] == "time", titles
        assert same(found[1:], samples.T) and same(found[0], TIMES), done
    assert "rounded" not in str(done) and len(done.files) == 1


@pytest.mark.parametrize("kind", ["f4", "f2", ">i2", "i4", "u2", ">f8", "i8", "u8", "longdouble"])
def test_samples_of_every_kind_are_the_same_in_float64_or_it_is_told(kind, tmp_path):
    whole = np.arange(64) * 37 % 100
    np.save(tmp_path / "a.npy", whole.astype(kind))
    done = convert([tmp_path / "a.npy"], tmp_path / "out", rate_hz=1000)
    assert same(table(done.files[0])[1][1], whole) and "rounded" not in str(done)
    if np.dtype(kind).itemsize < 8 or kind == ">f8":
        return
    wide = whole.astype(kind)
    wide[:3] = np.array([2**53 + 1, 2**62 + 1, 2**62]).astype(kind)
    np.save(tmp_path / "b.npy", wide)
    assert "2 values of b are rounded" in str(convert([tmp_path / "b.npy"], tmp_path / "out", rate_hz=1000))


def test_units_increments_and_offsets_are_kept_and_other_quantities_are_left_out_and_told(tmp_path):
    samples = noise(2000, 3)
    axes = {f"Acceleration_{axis}": own for axis, own in zip("XYZ", samples.T)}
    with TdmsWriter(tmp_path / "a.tdms") as file:
        shared = {"wf_increment": 1 / RATE_HZ, "wf_start_offset": 0.5}
        file.write_segment([
            *(ChannelObject("Log", name, own, {**shared, "unit_string": "g"}) for name, own in axes.items()),
            ChannelObject("Log", "Force", np.ones(2000), {**shared, "unit_string": "N"}),
        ])
    done = convert([tmp_path / "a.tdms"], tmp_path / "out")
    titles, found = table(done.files[0])
    assert [title.endswith("[g]") for title in titles] == [False, True, True, True]
    assert same(found[1:], samples.T) and found[0][0] == 0.5 and "left out: Force" in str(done)
    sound = convert([tmp_path / "a.tdms"], tmp_path / "out", wav=True)
    assert "--scale g" in str(sound)


@pytest.mark.parametrize("names_of, titles", [
    (["ax_g", "ay_g", "az_g"], ["accel_ax_g", "accel_ay_g", "accel_az_g"]),
    (["X (mg)", "Y (mg)", "Z (mg)"], ["accel_X (mg)", "accel_Y (mg)", "accel_Z (mg)"]),
])
@pytest.mark.parametrize("given", [None, "m/s^2"])
def test_the_reader_finds_the_unit_in_a_name_or_the_one_that_is_given(names_of, titles, given, tmp_path):
    samples = np.random.default_rng(2).standard_normal((RATE_HZ, 3))
    frame = pd.DataFrame(samples, columns=names_of)
    frame.insert(0, "t_ms", np.arange(RATE_HZ) / 5)
    frame.to_parquet(tmp_path / "a.parquet")
    done = convert([tmp_path / "a.parquet"], tmp_path / "out", unit=given)
    found = table(done.files[0])[0]
    assert found[0] == "time_ms" and (given or found[1:] == titles)
    scale = 1 if given else {"g": G, "mg": G / 1000}[names.unit_in(names_of[0])]
    read = sh.Recordings(done.files[0])[0].samples()
    assert np.allclose(read.T if read.shape[0] == 3 else read, samples * scale, atol=1e-5 * scale)


@pytest.mark.parametrize("save", [
    lambda frame, path: frame.to_parquet(path.with_suffix(".parquet")),
    lambda frame, path: hdf(frame, path.with_suffix(".h5")),
    lambda frame, path: hdf(frame, path.with_suffix(".h5"), is_table=True),
])
@pytest.mark.parametrize("unit", ["ns", "us"])
def test_an_index_of_dates_becomes_seconds_and_it_is_told(save, unit, tmp_path):
    samples = noise(500, 3)
    index = pd.DatetimeIndex(np.datetime64("2026-03-01T10:00:00", unit) + np.arange(500) * np.timedelta64(200, "us"))
    save(pd.DataFrame(columns(samples), index=index), tmp_path / "a")
    done = convert(list(tmp_path.glob("a.*")), tmp_path / "out")
    titles, found = table(done.files[0])
    assert titles[0] == "time_s" and same(found[0], np.arange(500) * 200 / 1e6) and same(found[1:], samples.T)
    assert "times in s from 2026-03-01T10:00:00" in str(done)


def cells(*parts: object) -> np.ndarray:
    found = np.empty(len(parts), dtype=object)
    found[:] = parts
    return found


def test_cells_structs_three_dimensions_and_groups_become_trials_with_a_list(tmp_path):
    one, two = noise(400, 3), noise(300, 3, seed=2)
    same_length = np.stack([noise(400, 3, seed=seed) for seed in range(4)])
    files = {
        "cells.mat": {"acc": cells(one, two), "speed_mm_s": [80.0, 160.0], "texture": cells("felt", "=cork")},
        "structs.mat": {"trial": cells({"acc": one, "force_n": 0.5}, {"acc": two, "force_n": 1.5})},
        "three.mat": {"acc": same_length, "force_n": [0.5, 1.5, 2.5, 3.5]},
        "last.mat": {"acc": np.moveaxis(same_length, 0, 2)},
    }
    for name, arrays in files.items():
        scipy.io.savemat(tmp_path / name, {**arrays, "fs": 1e3})
        expected = (one, two) if name in ("cells.mat", "structs.mat") else same_length
        first = convert([tmp_path / name], tmp_path / name[:-4])
        assert len(first.files) == len(expected) + 1 and first.files[-1].name == "trials.csv", first
        for file, own in zip(first.files, expected):
            assert same(table(file)[1][1:], own.T)
    with h5py.File(tmp_path / "groups.h5", "w") as file:
        for surface, own in (("felt", one), ("cork", two)):
            file[f"{surface}/acc"], file[f"{surface}/gyro"] = own, own
            file[f"{surface}"].attrs["sample_rate"], file[surface].attrs["material"] = 1000, surface
    done = convert([tmp_path / "groups.h5"], tmp_path / "groups")
    assert [file.name for file in done.files] == ["groups_cork_acc.csv", "groups_felt_acc.csv", "trials.csv"]
    assert "groups_felt_acc.csv,felt,," in done.files[2].read_text() and "left out" in str(done)
    for asked, count in (("felt", 1), ("*", 3), ("gyro", 3), ("felt/gyro", 1)):
        own = convert([tmp_path / "groups.h5"], tmp_path / f"as{len(asked)}", signal=asked, overwrite=True)
        assert len(own.files) == count, asked
    told = (tmp_path / "cells" / "trials.csv").read_text().splitlines()
    assert told == ["file,texture,speed_mm_s,force_n", "cells_acc_1.csv,felt,80.0,", "cells_acc_2.csv,'=cork,160.0,"]
    told = (tmp_path / "three" / "trials.csv").read_text().splitlines()
    assert told[2] == "three_acc_2.csv,,,1.5" and told[4] == "three_acc_4.csv,,,3.5"


def test_what_has_several_answers_is_refused_with_them_and_each_remedy_works(tmp_path):
    wide = noise(85_000, 5)
    scipy.io.savemat(tmp_path / "wide.mat", {"data": wide})
    np.savez(tmp_path / "two.npz", left=noise(100, 3), right=noise(100, 3), fs=1000)
    np.savez(tmp_path / "small.npz", acc=noise(2, 100, 3), fs=1000)
    h5(tmp_path / "loose.h5", one=noise(100), two=noise(100), fs=1000)
    for file, given, words, remedy, count in (
        ("wide.mat", {}, "--axes .*numbers from 1 to 5", {"axes": "2,3,4", "rate_hz": 1e4}, 1),
        ("wide.mat", {"axes": "1,2,3"}, "--rate HZ", {"axes": "each", "rate_hz": 1e4}, 6),
        ("two.npz", {}, "'left'.*'right'.*--signal", {"signal": "left"}, 1),
        ("two.npz", {"signal": "up"}, "up", {"signal": "*"}, 3),
        ("small.npz", {}, "--axes d3 or d1", {"axes": "d3"}, 3),
        ("loose.h5", {}, "one, two.*--axes", {"axes": "each"}, 3),
        ("loose.h5", {}, "one, two.*--axes", {"axes": "one,two"}, 1),
        ("wide.mat", {"axes": "2,3", "time": "6"}, "no '6'", {"axes": "2,3", "rate_hz": 1e3}, 1),
        ("loose.h5", {"time": "none", "signal": "two"}, "none", {"signal": "two"}, 1),
    ):
        out = tmp_path / f"{file}{remedy}"
        with pytest.raises(Refusal, match=words):
            convert([tmp_path / file], out, **given)
        assert not out.exists()
        assert len(convert([tmp_path / file], out, **remedy).files) == count, remedy
    found = table(tmp_path / f"wide.mat{ {'axes': '2,3,4', 'rate_hz': 1e4} }" / "wide.csv")[1]
    assert same(found[1:], wide[:, 1:4].T)


def test_a_rate_that_is_given_counts_and_what_disagrees_is_refused(tmp_path):
    samples = {**columns(noise(2000, 3)), "t": TIMES}
    scipy.io.savemat(tmp_path / "a.mat", {**samples, "fs": 1000.0})
    with pytest.raises(Refusal, match="fs = 1000.*'t' with steps of 0.0002.*--rate"):
        convert([tmp_path / "a.mat"], tmp_path / "a")
    done = convert([tmp_path / "a.mat"], tmp_path / "a", rate_hz=2000)
    assert table(done.files[0])[1][0][1] == 1 / 2000 and "--rate 2000 counts, and not fs = 1000, times 't'" in str(done)
    # Times in no unit are in the one by which both agree.
    scipy.io.savemat(tmp_path / "b.mat", {**samples, "t": TIMES * 1e6, "fs": 5.0e3})
    assert table(convert([tmp_path / "b.mat"], tmp_path / "b").files[0])[0][0] == "time_us"


def test_a_sheet_has_its_rows_with_empty_cells_and_its_facts_above_the_names(tmp_path):
    samples = np.random.default_rng(3).integers(-99, 99, (50, 3)) / 4
    rows = [[n, *row, 21.5 if n else None] for n, row in enumerate(samples.tolist())]
    rows[7][2] = None
    above = [["Logger 7"], ["Sample rate (Hz)", 500], [], ["No", "Acc X", "Acc Y", "Acc Z", "Temp"]]
    xlsx(tmp_path / "a.xlsx", *above, [None, "mg", "mg", "mg", "°C"], *rows)
    done = convert([tmp_path / "a.xlsx"], tmp_path / "out")
    titles, found = table(done.files[0])
    samples[7, 1] = np.nan
    assert titles[1:] == ["Acc X [mg]", "Acc Y [mg]", "Acc Z [mg]"] and "left out: No, Temp" in str(done)
    assert np.array_equal(found[1:], samples.T, equal_nan=True) and found[0][1] == 1 / 500


def test_what_is_in_a_file_is_told_as_a_tree_and_names_cannot_move_the_cursor(tmp_path, capsys):
    h5(tmp_path / "a.h5", **{"run\x1b[2J/acc": noise(100, 3), "run\x1b[2J/fs": 1000})
    assert main([str(tmp_path / "a.h5")]) == 0
    told = capsys.readouterr().out
    assert "\x1b" not in told and "    acc: 100 x 3 float64" in told and "    fs = 1000.0" in told
    assert sorted(os.listdir(tmp_path)) == ["a.h5"]


class Trap:
    """An object whose pickle makes a folder when it is loaded."""

    def __init__(self, place: Path):
        self.place = place

    def __reduce__(self):
        return os.mkdir, (str(self.place),)


def test_no_pickle_is_run(tmp_path):
    trap, place = Trap(tmp_path / "sprung"), tmp_path / "out"
    np.save(tmp_path / "a.npy", np.array([trap], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", acc=np.array([trap], dtype=object))
    frame = pd.DataFrame({"t": TIMES, **columns(noise(2000, 3))})
    hdf(frame, tmp_path / "a.h5", is_table=True)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        for owner, name in ((file["a"], "info"), (file["a/table"], "values_block_0_kind")):
            owner.attrs[name] = np.bytes_(pickle.dumps(trap, protocol=0))
    with pytest.raises(Refusal, match="objects of Python"):
        convert([tmp_path / "a.npy"], place)
    assert "acc = (not read: holds objects of Python" in str(convert([tmp_path / "a.npz"]))
    for name in ("a.npz", "a.h5"):
        with pytest.raises(Refusal):
            convert([tmp_path / name], place)
    assert not trap.place.exists() and not place.exists()


@pytest.mark.parametrize(
    "name", ["../../up", "/etc/up", "..", ".", "a/../../up", "C:\\up", "up\n,x", "=1+1", "ü" * 300, "-o"])
def test_no_name_in_a_file_is_a_path(name, tmp_path):
    with TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment([ChannelObject(group, name, noise(64), {"wf_increment": 1e-3, "unit_string": "g\n,1"})
                            for group in (name, f"{name}2")])
    done = convert([tmp_path / "a.tdms"], tmp_path / "out", signal="*", axes="each")
    assert sorted(os.listdir(tmp_path)) == ["a.tdms", "out"]
    assert {file.parent for file in done.files} == {tmp_path / "out"} and len(done.files) == 3
    for file in done.files[:2]:
        titles, found = table(file)
        assert len(titles) == 2 and same(found[1], noise(64))


def test_files_that_unpack_to_more_than_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(tree, "MOST_BYTES", 1 << 20)
    zeros = np.zeros((60_000, 3))
    scipy.io.savemat(tmp_path / "a.mat", {"acc": zeros, "fs": 1e3}, do_compression=True)
    np.savez_compressed(tmp_path / "a.npz", acc=zeros, fs=1e3)
    pd.DataFrame(zeros, columns=["ax", "ay", "az"]).to_parquet(tmp_path / "a.parquet")
    xlsx(tmp_path / "a.xlsx", *[["x"] * 3 for _ in range(60_000)])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("acc", (60_000, 3), "f8")
        file["fs"] = 1e3
    np.save(tmp_path / "a.npy", zeros)
    for file in tmp_path.iterdir():
        assert file.stat().st_size < 1 << 20 or file.suffix == ".npy"
        with pytest.raises(Refusal, match="1 MiB|no accelerations"):
            convert([file], tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_links_of_hdf5_lead_to_no_other_file_and_not_in_circles(tmp_path):
    (tmp_path / "secret").write_bytes(bytes(8000))
    h5(tmp_path / "other.h5", acc=noise(500, 3))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/fs"] = 1000
        file["run/own"] = file["run"]
        file["run/acc"] = h5py.ExternalLink("other.h5", "acc")
        file.create_dataset("run/accel", (500, 2), "f8", external=[(str(tmp_path / "secret"), 0, 8000)])
        layout = h5py.VirtualLayout((500, 3), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "acc", (500, 3))
        file.create_virtual_dataset("run/a_x", layout)
    told = str(convert([tmp_path / "a.h5"]))
    assert told.count("another file") == 3 and "within itself" in told
    with pytest.raises(Refusal, match="no accelerations"):
        convert([tmp_path / "a.h5"], tmp_path / "out")


@pytest.mark.parametrize("file", WRITERS)
def test_a_broken_file_is_refused_by_its_name_and_leaves_nothing(file, tmp_path):
    WRITERS[file](tmp_path / file, noise(len(TIMES), 3))
    whole = (tmp_path / file).read_bytes()
    generator = np.random.default_rng(7)
    for attempt in range(12):
        data = bytearray(whole)
        if attempt < 4:
            data = data[: int(len(data) * attempt / 4)]
        else:
            places = generator.integers(0, min(len(data), 4096) if attempt % 2 else len(data), 20)
            for place in places:
                data[place] = generator.integers(256)
        (tmp_path / file).write_bytes(data)
        try:
            convert([tmp_path / file], tmp_path / "out")
        except Refusal as fault:
            assert file in str(fault) and sorted(os.listdir(tmp_path)) == [file], fault
        else:
            for own in (tmp_path / "out").iterdir():
                own.unlink()
            (tmp_path / "out").rmdir()


def test_an_output_that_is_there_stays_and_outputs_come_together_or_not_at_all(tmp_path):
    for name in ("a", "b"):
        np.savez(tmp_path / f"{name}.npz", acc=noise(100, 3), fs=1000)
    (tmp_path / "c.npz").write_bytes(b"PK")
    out = tmp_path / "out"
    files = [tmp_path / f"{name}.npz" for name in "abc"]
    with pytest.raises(Refusal, match="c.npz"):
        convert(files, out)
    assert not out.exists()
    out.mkdir()
    (out / "b.csv").write_text("mine")
    for given in (files, files[:2]):
        with pytest.raises(Refusal, match="c.npz|b.csv is there already: give --overwrite"):
            convert(given, out)
        assert sorted(os.listdir(out)) == ["b.csv"] and (out / "b.csv").read_text() == "mine"
    assert main([str(files[1]), "--out", str(out)]) == 2
    assert main([str(files[1]), "--out", str(out), "--overwrite"]) == 0
    assert len(table(out / "b.csv")[0]) == 4 and sorted(os.listdir(out)) == ["b.csv"]
    # The same name in two folders is two recordings.
    (tmp_path / "other").mkdir()
    np.savez(tmp_path / "other" / "a.npz", acc=noise(100, 3, seed=5), fs=1000)
    done = convert([files[0], tmp_path / "other" / "a.npz"], tmp_path / "both")
    assert [file.name for file in done.files] == ["a.csv", "a_2.csv", "trials.csv"]


@pytest.mark.parametrize("module, pip", [("scipy.io", "scipy"), ("h5py", "h5py"), ("nptdms", "npTDMS"),
                                         ("pyarrow.parquet", "pyarrow"), ("openpyxl", "openpyxl")])
def test_a_library_that_is_absent_is_named_with_its_line(module, pip, tmp_path, monkeypatch):
    files = {"scipy": "matrix.mat", "h5py": "plain.h5", "npTDMS": "log.tdms", "pyarrow": "frame.parquet"}
    file = files.get(pip, "sheet.xlsx")
    WRITERS[file](tmp_path / file, noise(len(TIMES), 3))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(Refusal, match=f"{file}.*pip install {pip}"):
        convert([tmp_path / file])


def test_converted_files_are_fitted_by_the_command_as_the_samples_are(command, tmp_path, signals):
    samples = signals["felt", 80.0, 0.5]
    np.savez(tmp_path / "felt.npz", acc=samples, fs=RATE_HZ, unit="m/s^2")
    fits = []
    for wav in (False, True):
        (file,) = convert([tmp_path / "felt.npz"], tmp_path / f"out{wav}", wav=wav).files
        command.succeed("fit", file, "--out", tmp_path / f"{wav}.lib")
        fits.append((tmp_path / f"{wav}.lib").read_bytes())
    own = sh.fit([sh.Recording(samples, RATE_HZ, texture="felt")])
    assert fits[0] == fits[1] == bytes(own.library)


def test_a_pattern_that_no_shell_has_replaced_stands_for_its_files(tmp_path):
    for name in ("take1.npy", "take2.npy", "take[1].npy"):
        np.save(tmp_path / name, noise(2000, 3))
    assert main([str(tmp_path / "take?.npy"), "--rate", "5000", "--unit", "g", "--out", str(tmp_path / "out")]) == 0
    assert sorted(file.name for file in (tmp_path / "out").glob("*.csv")) == ["take1.csv", "take2.csv", "trials.csv"]
    assert main([str(tmp_path / "take[1].npy"), "--rate", "5000", "--unit", "g", "--out", str(tmp_path / "one")]) == 0
    assert [file.name for file in (tmp_path / "one").glob("*.csv")] == ["take_1.csv"]
