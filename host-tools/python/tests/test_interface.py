"""The names, signatures and docstrings of the module, against its stubs and the command's defaults."""

import dataclasses
import inspect
import re
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


# Options of the command's `fit` that the package has at its recordings, or that only a command line needs.
NOT_OF_FIT = {
    *("start", "duration", "sample-rate", "time-unit", "even-times", "scale", "speed", "force", "each", "texture"),
    "strokes",
    *("out", "overwrite", "json", "parts", "shard", "merge", "quiet", "full", "help"),
}


def test_every_option_of_a_fit_is_a_parameter_with_its_default(command):
    told = command.succeed("fit", "--help")
    parameters = inspect.signature(sh.fit).parameters
    for option in set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", told, re.MULTILINE)) - NOT_OF_FIT:
        name = option.replace("-", "_")
        # A parameter has its unit in its name.
        found = [of for of in parameters if of == name or re.fullmatch(f"{name}_(m_s2|hz)", of)]
        assert len(found) == 1, f"--{option}: {found}"
        of_option = re.search(rf"\n +--{option} .*?(?=\n +(?:-\w, )?--|\Z)", told, re.DOTALL)
        default = of_option and re.search(r"\[default: (.*?)\]", of_option[0])
        if default:
            assert str(parameters[found[0]].default) == default[1], option
