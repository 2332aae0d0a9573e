"""Execute the notebooks of examples/ and the tutorials in place, with the outputs that pages show: `make pictures`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from pages import ROOT

NOTEBOOKS = sorted([*(ROOT / "examples").glob("*/*.ipynb"), *(ROOT / "docs" / "tutorials").glob("*.ipynb")])


def executed(path: Path) -> nbformat.NotebookNode:
    """Return a notebook with its outputs; raise nbclient's CellExecutionError for a cell that fails."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": path.parent}}).execute()
    return notebook


def tidied(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Return a notebook without what differs from run to run: times, widgets that are gone, lines beside pictures."""
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if "outputs" in cell:
            cell.outputs = [each for each in map(_tidied, cell.outputs) if each is not None]
    notebook.metadata.pop("widgets", None)
    notebook.metadata.language_info = {"name": "python"}
    return notebook


def _tidied(output: Mapping[str, Any]) -> Mapping[str, Any] | None:
    data = output.get("data", {})
    if output["output_type"] == "stream" or any("widget" in kind for kind in data):
        return None
    if "image/png" in data:
        output["data"] = {"image/png": data["image/png"]}
    return output


def main() -> None:
    """Execute and write all notebooks."""
    for path in NOTEBOOKS:
        nbformat.write(tidied(executed(path)), path)


if __name__ == "__main__":
    main()
