"""A stylus on a link: the device's own application, on fake hardware, behind a TCP port."""

import os

import pytest
import stylus_haptics as sh

from conftest import ANSWER_S


def test_a_library_is_uploaded_listed_played_and_stopped(stylus, fitted, command):
    told = []
    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        assert device.link == stylus and device.info["product"] == "stylus"
        slot = device.upload(fitted, activate=True, progress=lambda done, total: told.append((done, total)))
        assert told[-1][0] == told[-1][1] == len(bytes(fitted.library))
        slots = device.slots()
        active = next(one for one in slots if one["active"])
        assert active["slot"] == slot and [t["name"] for t in active["textures"]] == ["felt", "cork"]
        played = device.play(texture="felt", speed_mm_s=120, force_n=1, seconds=0.6)
        assert played["motions"] > 0 and played["seconds"] >= 0.6 and played["missed_ticks"] == 0
        moved = device.play(texture="cork", motion=sh.Motion([0, 0.3], [50, 100], 1.0))
        assert moved["motions"] > 0 and moved["seconds"] >= 0.3
        sensed = device.play(texture="felt", seconds=0.5)
        assert sensed["motions"] == 0 and sensed["keep_alives"] > 0
        assert device.stop() is False
        assert device.status()["muted"] == ["not playing"]
        contents = device.slots()
    # The command sees the same, once the link is free.
    assert command.json("slots", "--json", "--link", stylus) == contents


def test_refusals_of_the_device_are_exceptions_of_the_link(stylus, fitted):
    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        device.upload(fitted, activate=True)
        with pytest.raises(sh.StylusError, match="felt") as caught:
            device.play(texture="silk", speed_mm_s=1, force_n=1, seconds=1)
        assert caught.value.kind == "link"
        for keywords in ({}, {"texture": "felt", "scene": "x"}, {"texture": "felt"}):
            with pytest.raises(sh.StylusError):
                device.play(speed_mm_s=1, force_n=1, **keywords)
    with pytest.raises(sh.StylusError, match="closed"):
        device.status()


def test_settings_are_read_and_what_protects_less_wants_a_yes(stylus):
    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        before = {row["name"]: row for row in device.settings()}
        limit = before["power-limit"]["value"]
        device.change_settings({"power-limit": limit / 2}, accept=True)
        with pytest.raises(sh.StylusError, match="accept=True"):
            device.change_settings({"power-limit": limit})
        after = {row["name"]: row["value"] for row in device.settings()}
        assert after["power-limit"] == pytest.approx(limit / 2)
        with pytest.raises(sh.StylusError, match="no setting"):
            device.change_settings({"loudness": 1})


def answered(look):
    """The only row that `look` lists, once it answers. On a busy computer a list may not wait long enough."""
    for _ in range(100):
        (row,) = look()
        if "no answer" not in row["state"]:
            break
    return row


def test_what_is_attached_is_listed_as_by_the_command_and_the_only_one_is_used(attached, command):
    row = answered(sh.devices)
    assert (row["link"], row["kind"], row["state"]) == (attached, "virtual", "answers")
    with sh.Device(timeout_s=ANSWER_S) as device:
        assert device.link == attached
        assert row["serial_number"] == device.info["serial"]
    assert row == answered(lambda: command.json("devices", "--json"))


def test_a_link_that_is_open_is_refused_to_the_command_and_stays_open(attached, command):
    with sh.Device(timeout_s=ANSWER_S) as device:
        assert f"(process {os.getpid()}): close that program" in command.refuse("status")
        assert device.status()["muted"] == ["not playing"]


def test_ctrl_c_stops_the_output_before_it_is_raised(stylus, fitted, ctrl_c):
    with sh.Device(stylus, timeout_s=ANSWER_S) as device:
        device.upload(fitted, activate=True)
        along = {"speed_mm_s": 120, "force_n": 1, "seconds": 3600}
        with pytest.raises(KeyboardInterrupt):
            device.play(texture="felt", **along, progress=lambda *_: ctrl_c.set())
        assert device.status()["muted"] == ["not playing"] and device.stop() is False
