"""The tutorials run from their first cell to their last, and their stored outputs are complete and small."""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import photonbeams as pb
from tests.helpers.sweep import sweep

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials"
# The line that is added to the first cell, and the number of pictures.
TINY = {
    "talk": ("WIDTH, HEIGHT = 32, 18", 10),
    "caustic": ("WIDTH, PASSES, SAMPLES = 32, 1, 2", 1),
    "fit": ("WIDTH, HEIGHT, STEPS = 32, 18, 12", 3),
    "plate": ("WIDTH, HEIGHT, PASSES, SAMPLES = 32, 18, 1, 2", 1),
}
PLACES = ("/home", "/root", "/tmp", "/work", "C:")


def outputs_of(notebook):
    return [each for cell in notebook.cells for each in cell.get("outputs", [])]


def pictures_in(notebook):
    return sum("image/png" in each.get("data", {}) for each in outputs_of(notebook))


def test_each_tutorial_is_tried():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(TINY)


# The caustic's scene is one of examples/mitsuba, whose pictures in Python are those of docs/mitsuba.md.
@pytest.mark.parametrize("name", sweep(TINY, ("talk", "fit")))
def test_every_cell_runs(name, monkeypatch, tmp_path):
    for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(variable, str(tmp_path))  # the user's own files are neither used nor written
    own, more = str(Path(pb.__file__).parents[1]), os.getenv("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", f"{own}{os.pathsep}{more}" if more else own)
    sizes, pictures = TINY[name]
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    first = next(cell for cell in notebook.cells if cell.cell_type == "code")
    assert sizes.partition(" = ")[0].split(", ")[0] in first.source
    first.source += "\n" + sizes
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": FOLDER}}).execute()
    assert not [each for each in outputs_of(notebook) if each.output_type == "error"]
    assert pictures_in(notebook) == pictures


@pytest.mark.parametrize("name", TINY)
def test_what_is_stored_is_whole_small_and_names_no_place_on_a_machine(name):
    path = FOLDER / f"{name}.ipynb"
    stored = nbformat.read(path, as_version=4)
    nbformat.validate(stored)
    numbers = [cell.execution_count for cell in stored.cells if cell.cell_type == "code"]
    assert numbers == [*range(1, len(numbers) + 1)]
    assert pictures_in(stored) == TINY[name][1]
    assert path.stat().st_size < 600_000
    texts = [cell.source for cell in stored.cells]
    texts += [
        str(text) for each in outputs_of(stored) for kind, text in each.get("data", {}).items() if "image" not in kind
    ]
    assert not [each for each in texts if any(place in each for place in PLACES)]
