"""The names, signatures and docstrings of the module, against its stubs and the command's defaults."""

import dataclasses
import inspect
import subprocess
import sys
from importlib import resources

import stylus_haptics as sh
from stylus_haptics import _native, _results


def public(owner):
    return [name for name in vars(owner) if not name.startswith("_")]


def test_the_stubs_say_what_the_module_has():
    done = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "stylus_haptics"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (resources.files(sh) / "py.typed").is_file() and (resources.files(sh) / "_native.pyi").is_file()


def test_the_package_gives_all_that_the_module_has():
    results = {name for name, thing in vars(_results).items() if getattr(thing, "__module__", "") == _results.__name__}
    results = {name for name in results if not name.startswith("_")}
    assert sorted(set(public(_native)) | results | {"__version__"}) == sorted(sh.__all__)


def test_everything_public_has_a_docstring():
    for name in sh.__all__:
        thing = getattr(sh, name)
        if not (inspect.isclass(thing) or inspect.isroutine(thing)):
            continue
        assert thing.__doc__, name
        for member in public(thing) if inspect.isclass(thing) and not issubclass(thing, Exception) else []:
            assert getattr(thing, member).__doc__, f"{name}.{member}"
        for field in dataclasses.fields(thing) if dataclasses.is_dataclass(thing) else []:
            said = f"``{field.name}``" in thing.__doc__ or field.name in ("texture", "name")
            assert said, f"{name}.{field.name}"


def test_the_defaults_are_the_commands(command):
    told = command.succeed("fit", "--help")
    signature = inspect.signature(sh.fit)
    for option, name in [
        ("--order", "order"),
        ("--reduce", "reduce"),
        ("--high-pass", "high_pass"),
        ("--silence-floor", "silence_floor_m_s2"),
        ("--excitation", "excitation"),
        ("--modulation", "modulation"),
        ("--lines", "lines"),
        ("--floor", "floor"),
        ("--model-rate", "model_rate_hz"),
    ]:
        of_option = told.split(f"\n      {option} ", 1)[1].split("[default: ", 1)[1].split("]", 1)[0]
        assert str(signature.parameters[name].default) == of_option, option
