"""Plug-ins of OpenUSD that cannot be loaded: it goes on without them, and so do we, with a warning."""

import json
import os
import subprocess
import sys

import pytest

LIBRARY = {"Type": "library", "Name": "gone", "LibraryPath": "gone.so", "Root": ".", "ResourcePath": "."}
RESOLVER = {**LIBRARY, "Info": {"Types": {"GoneResolver": {"bases": ["ArResolver"]}}}}
BROKEN = {"no JSON": ('{"Plugins":[{', "couldn't be read (line 1, col 13)"),
          "no library": (json.dumps({"Plugins": [RESOLVER]}), "gone.so: cannot open shared object file")}  # fmt: skip
FORMAT = {"bases": ["SdfFileFormat"], "formatId": "gone", "extensions": ["gone"], "target": "usd", "primary": True}
# A process of its own, because OpenUSD looks for plug-ins once.
FIRST_USE = """
import sys
from photonbeams.scene import SceneError
from photonbeams.usd.common.openusd import plugin_problem
from photonbeams.usd.stage import open_stage
try:
    open_stage(sys.argv[1])
except SceneError as error:
    print(error)
print(plugin_problem())
"""


def first_use(folder, plugins, name="shot.usda"):
    """Return what is printed where a stage is opened with plug-ins, and their description as a file."""
    (folder / "plugInfo.json").write_text(plugins)
    (folder / name).write_text("#usda 1.0\n")
    command = [sys.executable, "-c", FIRST_USE, str(folder / name)]
    return subprocess.run(
        command, env=os.environ | {"PXR_PLUGINPATH_NAME": str(folder)}, capture_output=True, text=True, check=True
    )


@pytest.mark.parametrize("kind", BROKEN)
def test_openusd_goes_on_without_plugins_that_it_cannot_load(tmp_path, kind):
    text, reason = BROKEN[kind]
    child = first_use(tmp_path, text)
    (problem,) = child.stdout.splitlines()
    assert problem.startswith(f"OpenUSD goes on without plug-ins of PXR_PLUGINPATH_NAME ('{tmp_path}'): ")
    assert reason in problem and child.stderr.startswith(problem[:100])
    assert len(child.stderr.splitlines()) == 1


def test_a_stage_of_a_format_whose_plugin_cannot_be_loaded_is_refused_with_the_reason(tmp_path):
    child = first_use(tmp_path, json.dumps({"Plugins": [{**LIBRARY, "Info": {"Types": {"Gone": FORMAT}}}]}), "a.gone")
    assert child.stdout.startswith(f"{tmp_path}/a.gone cannot be read: Failed to load plugin 'gone': ")
