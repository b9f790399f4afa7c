"""Arrays at every door, whatever memory they lie in: what a door takes is NumPy's own copy."""

import numpy as np
import pytest
import stylus_haptics as sh
from numpy.lib.stride_tricks import as_strided
from stylus_haptics import _native

KINDS = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u2", "u4")


def view(generator, dtype, count, memory):
    """A view of `count` items of `dtype` in `memory`: in a record of any size, from any byte, forwards, backwards, or
    one item again and again."""
    dtype, offset = np.dtype(dtype), int(generator.integers(0, 17))
    step = int(generator.choice([0, dtype.itemsize, 2 * dtype.itemsize, dtype.itemsize + generator.integers(1, 9)]))
    if step == 0 or generator.random() < 0.5:
        whole = np.ndarray((count,), dtype, memory, offset, (step,))
    else:
        record = np.dtype({"names": ["item"], "formats": [dtype], "offsets": [0], "itemsize": step})
        whole = np.ndarray((count,), record, memory, offset)["item"]
    return whole if generator.random() < 0.5 else whole[::-1]


def views(kinds=KINDS, cases=60, largest=40):
    """Views of random dtypes with random contents, none of which a door refuses for its size; and their memory."""
    for seed in range(cases):
        generator = np.random.default_rng(seed)
        dtype = np.dtype(str(generator.choice(["<", ">"])) + str(generator.choice(kinds)))
        count = int(generator.integers(1, largest))
        memory = bytearray(17 + (count + 1) * 3 * 16)
        one = view(generator, dtype, count, memory)
        one[...] = generator.integers(0, 100, count)
        one.flags.writeable = generator.random() < 0.5
        yield one


def test_the_views_are_of_all_kinds_that_are_misread_most():
    found = list(views())
    assert any(not one.flags.aligned for one in found)
    assert any(one.strides[0] % one.itemsize for one in found)
    assert any(one.strides[0] < 0 for one in found) and any(one.strides[0] == 0 for one in found)
    assert any(not one.dtype.isnative for one in found) and any(not one.flags.writeable for one in found)


def test_a_motion_of_any_view_is_that_of_its_copy():
    for one in views(cases=200):
        times, numbers = np.arange(len(one), dtype="f8"), np.array(one, "f8")
        moved = sh.Motion(times, one, one)
        for time, number in zip(times, numbers):
            assert moved.at(time) == (number, number), (one.dtype, one.strides)
    times = np.zeros(6, [("f", "<f8"), ("n", "<i4")])
    times["f"] = range(6)
    assert [sh.Motion(times["f"], times["f"], 1).at(time)[0] for time in range(6)] == list(range(6))


def test_a_recording_of_any_view_is_that_of_its_copy():
    for one in views(("f2", "f4", "f8", "i2", "i4"), cases=200):
        copy = np.array(one, one.dtype.newbyteorder("="))
        taken, expected = (sh.Recording(array, 5000, texture="felt").samples() for array in (one, copy))
        assert np.array_equal(taken, expected), (one.dtype, one.strides)
    generator = np.random.default_rng(1)
    axes = generator.standard_normal((50, 3))
    for array in (np.asfortranarray(axes), axes.astype(">f4"), axes[::-1, ::-1], np.repeat(axes, 2, 1)[:, ::2]):
        taken, expected = (sh.Recording(one, 5000, texture="felt").samples() for one in (array, np.array(array, "f8")))
        assert np.array_equal(taken, expected) and taken.shape == (50, 3)


def test_the_words_of_any_view_are_written_as_those_of_its_copy(tmp_path):
    for one in views(("i1", "i2", "u2", "i4"), cases=60):
        for name, words in (("a.wav", one), ("b.wav", np.array(one, "i4"))):
            _native._write_wav(tmp_path / name, words, 5000, None, True)
        assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes(), (one.dtype, one.strides)
    for words in (np.ones(3), np.ones(3, "i8"), ["a"], np.ones((2, 2), "i4")):
        with pytest.raises(TypeError, match="words"):
            _native._write_wav(tmp_path / "a.wav", words, 5000, None, True)


def test_a_player_fills_any_view_as_numpy_does_and_nothing_beside_it(fitted):
    for seed in range(200):
        generator = np.random.default_rng(seed)
        count = int(generator.integers(0, 300))
        column = (lambda one: one[:, None]) if generator.random() < 0.3 else (lambda one: one)
        player, other = (sh.Player(fitted, "felt", output_rate_hz=5000) for _ in range(2))
        memories = [bytearray(generator.bytes(17 + 13 * (count + 1)))]
        memories.append(bytearray(memories[0]))
        choices = generator.bit_generator.state
        out, expected = [], np.empty(count, "f4")
        for memory in memories:
            generator.bit_generator.state = choices
            out.append(column(view(generator, "=f4", count, memory)))
        for one in (player, other):
            one.move(130, 0.8)
        player.fill(out[0])
        other.fill(expected)
        out[1][...] = column(expected)
        assert memories[0] == memories[1], (seed, out[0].strides)


def test_a_player_refuses_views_of_other_dtypes_and_writes_nothing(fitted):
    player = sh.Player(fitted, "felt", output_rate_hz=5000)
    player.move(130, 0.8)
    swapped = np.dtype("f4").newbyteorder("S").str
    for one in views((swapped[1:], "f8", "i4"), cases=40):
        if one.dtype == np.dtype("f4") and one.flags.writeable:
            continue
        before = one.tobytes()
        with pytest.raises(TypeError, match="writable array of float32"):
            player.fill(one)
        assert one.tobytes() == before
    with pytest.raises(sh.StylusError, match="at most"):
        player.fill(as_strided(np.zeros(1, "f4"), (10**12,), (0,)))
