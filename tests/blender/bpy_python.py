"""The Python that has Blender as a module: bpy brings libraries of its own, so it has an environment of its own."""

import sys
from pathlib import Path

PYTHON = Path(sys.prefix) / "bpy" / "bin" / "python"
