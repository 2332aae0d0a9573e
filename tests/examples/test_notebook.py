"""The example notebook runs from its first cell to its last, and its stored outputs are complete and small."""

import os
from base64 import b64decode
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import photonbeams as pb

PATH = Path(__file__).parents[2] / "examples" / "notebook" / "first_light.ipynb"
WIDGET = "application/vnd.jupyter.widget-view+json"
# These replace the notebook's own sizes; the last two are for pictures that a shot and the widget show themselves.
TINY = """
WIDTH, PASSES = 32, 1
import photonbeams.shot.notebook; photonbeams.shot.notebook.LONGEST = 32
import photonbeams.studio.widget; photonbeams.studio.widget._LONGEST = 32
"""
WAIT = """
import time
while not widget.picture: time.sleep(0.02)
"""


@pytest.fixture(scope="module")
def stored():
    return nbformat.read(PATH, as_version=4)


def outputs_of(notebook):
    return [each for cell in notebook.cells for each in cell.get("outputs", [])]


def data_of(notebook):
    """Return MIME types and data of all outputs."""
    return [pair for each in outputs_of(notebook) for pair in each.get("data", {}).items()]


def kinds_of(notebook):
    return [kind for kind, _ in data_of(notebook)]


def test_every_cell_runs_and_shows_what_it_is_to_show(stored, monkeypatch, tmp_path):
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path))  # the user's own files are neither used nor written
    own, more = str(Path(pb.__file__).parents[1]), os.getenv("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", f"{own}{os.pathsep}{more}" if more else own)
    notebook = nbformat.from_dict(stored)
    first = next(cell for cell in notebook.cells if "WIDTH, PASSES" in cell.source)
    first.source += TINY
    notebook.cells.append(nbformat.v4.new_code_cell(WAIT))
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": PATH.parent}}).execute()
    assert not [each for each in outputs_of(notebook) if each.output_type == "error"]
    kinds = kinds_of(notebook)
    assert kinds.count("image/png") == 5 and kinds.count(WIDGET) == 1
    assert ("text/plain", "True") in data_of(notebook)  # another look leaves the surfaces as they are
    (sent,) = pictures_of(notebook)  # sent by the session's thread
    assert sent in (b"\xff\xd8", b"\x89P")  # a JPEG, or a PNG after all passes


def pictures_of(notebook):
    """Return the first two bytes of each picture in the final state of the widgets."""
    models = notebook.metadata.widgets["application/vnd.jupyter.widget-state+json"].state.values()
    buffers = [each for model in models for each in model.get("buffers", [])]
    return [b64decode(each["data"])[:2] for each in buffers if each["path"] == ["picture", "data"]]


def test_the_stored_outputs_are_those_of_its_cells_but_for_the_widget(stored):
    nbformat.validate(stored)
    assert kinds_of(stored).count("image/png") == 5 and WIDGET not in kinds_of(stored)
    numbers = [cell.execution_count for cell in stored.cells if cell.cell_type == "code"]
    assert numbers == [*range(1, len(numbers) + 1)]


def test_the_stored_file_is_small_and_names_no_place_on_a_machine(stored):
    assert PATH.stat().st_size < 400_000
    texts = [cell.source for cell in stored.cells] + [text for kind, text in data_of(stored) if kind != "image/png"]
    assert not [each for each in texts if any(place in each for place in ("/home", "/root", "/tmp", "/work", "C:"))]
