"""The notebook is kept with its outputs, which are those that it makes.

`UPDATE=1 pytest host-tools/python/tests/test_notebook.py` runs it and keeps what it makes.
"""

import asyncio
import os
import re
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent.parent / "examples" / "recording_to_texture.ipynb"


def shown(notebook) -> list[list[tuple[str, str]]]:
    """What each cell of code shows, in words; of sounds and pictures only that they are there."""
    cells = []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            data = [output.get("data", {"text": output.get("text", "")}) for output in cell.outputs]
            parts = [part for one in data for part in sorted(one.items())]
            texts = [(kind, "" if kind.startswith("image") else value) for kind, value in parts]
            cells.append([(kind, re.sub(r"base64,[^\"]+", "", value)) for kind, value in texts])
    return cells


def test_the_notebook_is_kept_with_the_outputs_that_it_makes(tmp_path, monkeypatch):
    # With a backend of its own no figure would be in the notebook.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    kept = shown(notebook)
    # The second time over the files of the first, as "Run All" does again.
    for _ in range(2):
        resources = {"metadata": {"path": str(tmp_path)}}
        client = NotebookClient(notebook, timeout=600, record_timing=False, resources=resources)
        asyncio.run(client.async_execute())
    notebook.metadata["language_info"] = {"name": "python"}
    assert (tmp_path / "textures.lib").stat().st_size > 1000 and (tmp_path / "page.html").stat().st_size > 100_000
    kinds = [kind for cell in shown(notebook) for kind, _ in cell]
    assert kinds.count("image/png") == 4 and "SIMULATED" in str(shown(notebook))
    if os.environ.get("UPDATE"):
        nbformat.write(notebook, NOTEBOOK)
        assert NOTEBOOK.stat().st_size < 1_000_000
    else:
        assert shown(notebook) == kept, "UPDATE=1 keeps what the notebook makes now"
        assert "recordings are simulated" in notebook.cells[0].source
