"""The notebook runs, draws, and is kept without outputs."""

import asyncio
import shutil
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent.parent / "examples" / "recording_to_texture.ipynb"


def test_the_notebook_is_kept_without_outputs_and_says_that_its_recordings_are_simulated():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in cells)
    assert "recordings are simulated" in notebook.cells[0].source


def test_the_notebook_runs_and_draws(tmp_path):
    notebook = nbformat.read(shutil.copy(NOTEBOOK, tmp_path), as_version=4)
    client = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    asyncio.run(client.async_execute())
    picture = (tmp_path / "texture.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 20_000
    assert (tmp_path / "textures.lib").stat().st_size > 1000
    # The figures were drawn of the textures and not of nothing.
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    texts = "".join(output.get("text", "") + str(output.get("data", "")) for output in shown)
    assert "denim: C" in texts and "judged on the rest" in texts
