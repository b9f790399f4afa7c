"""Runs every command of TUTORIAL.md in an empty folder, and compares what it prints and draws with what stands there.

    python3 host-tools/examples/tutorial/check.py [--write]

With `--write` the outputs and pictures in the repository are renewed. The program is $STYLUS_PROGRAM, or else
`cargo stylus`.

Commands stand in fences without a language. A fence `text` has what the last command before it prints; a pattern behind
the word says which lines of it. Longer lines are folded. Pictures are those files of the tutorial's folder that a
command leaves under the same name.
"""

import difflib
import os
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[2]
PAGE = ROOT / "TUTORIAL.md"
RENEW = "python3 host-tools/examples/tutorial/check.py --write renews it"
COLUMNS = 110


def run(line: str, place: Path) -> str:
    words = shlex.split(line, comments=True)
    if words[:2] == ["cargo", "stylus"]:
        program = os.environ.get("STYLUS_PROGRAM")
        cargo = ["cargo", "run", "--locked", "--release", "--quiet", "--manifest-path", str(ROOT / "Cargo.toml")]
        words = ([program] if program else [*cargo, "--package", "host-tools", "--bin", "stylus", "--"]) + words[2:]
    elif words[0] == "python3":
        words[0] = sys.executable
    elif words[0] != "head":
        raise SystemExit(f"TUTORIAL.md has a command that nobody runs: {line}")
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "encoding": "utf-8"}
    done = subprocess.run(words, cwd=place, **told)
    refused = "  # refused" in line
    if (done.returncode != 0) != refused:
        raise SystemExit(f"TUTORIAL.md: `{line}` ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


def quoted(output: str, pattern: str) -> list[str]:
    folded = textwrap.TextWrapper(COLUMNS, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    lines = [line.rstrip() for line in output.splitlines() if re.search(pattern, line)]
    # Long lines are of tables whose columns are far apart.
    lines = [line if len(line) <= COLUMNS else re.sub(" {3,}", "  ", line) for line in lines]
    return [part for line in lines for part in folded.wrap(line) or [""]]


def renewed(text: str, place: Path) -> str:
    """The page with the outputs of its commands as they are now."""
    made: list[str] = []
    output, fence = "", None
    for line in text.splitlines():
        mark = line.startswith("```")
        if mark and fence is None:
            fence = line[3:]
            made.append(line)
            if fence.startswith("text"):
                lines = quoted(output, fence[4:].strip())
                if not lines:
                    raise SystemExit(f"TUTORIAL.md: no line of the output matches {fence}:\n{output}")
                made += lines
        elif mark:
            fence = None
            made.append(line)
        elif fence is None or not fence.startswith("text"):
            made.append(line)
            if fence == "" and line.strip():
                output = run(line, place)
    return "\n".join(made) + "\n"


def main() -> None:
    write = sys.argv[1:] == ["--write"]
    stale = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "host-tools").symlink_to(ROOT / "host-tools")
        text = PAGE.read_text(encoding="utf-8")
        new = {PAGE: renewed(text, place).encode()}
        named = set(re.findall(r"\]\(host-tools/examples/tutorial/(\S+\.svg)\)", text))
        for name in sorted(named):
            found = next((path for path in place.rglob(name) if "host-tools" not in path.parts), None)
            if found is None:
                raise SystemExit(f"TUTORIAL.md: no command draws {name}")
            new[FOLDER / name] = found.read_bytes()
        for path, content in new.items():
            if not path.exists() or path.read_bytes() != content:
                stale.append(path.relative_to(ROOT))
                if write:
                    path.write_bytes(content)
                elif path == PAGE:
                    there, now = text.splitlines(), content.decode().splitlines()
                    print(*difflib.unified_diff(there, now, "TUTORIAL.md", "as it is made now", lineterm=""), sep="\n")
        unnamed = {path.name for path in FOLDER.glob("*.svg")} - named
        if unnamed:
            raise SystemExit(f"host-tools/examples/tutorial: no picture of TUTORIAL.md: {', '.join(sorted(unnamed))}")
    for path in stale:
        print(f"{path}: {'written' if write else f'not what the commands make now; {RENEW}'}")
    if stale and not write:
        raise SystemExit(1)
    print(f"TUTORIAL.md: its commands run, with {len(named)} pictures")


main()
