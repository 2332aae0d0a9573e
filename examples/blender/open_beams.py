"""Open exported beams in Blender, and print what it has read: curves, points, radii and colours.

    photonbeams beams dusty.usda -o out/beams.usdc
    python examples/blender/open_beams.py out/beams.usdc [out/beams.blend]

Runs in any Python that has the package `bpy` (tried: bpy 5.0.1, Python 3.11), or in Blender itself:
blender --background --python examples/blender/open_beams.py -- out/beams.usdc
"""

import sys
from pathlib import Path

import bpy
import numpy as np


def open_beams(path):
    """Import a stage into an empty file and return its curves objects."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(Path(path).absolute()))
    return [each for each in bpy.context.scene.objects if each.type == "CURVES"]


def told(curves):
    """Return a line about an object: its numbers of curves and points, and its least and greatest radius."""
    data = curves.data
    radii = np.zeros(len(data.points), dtype=np.float32)
    data.attributes["radius"].data.foreach_get("value", radii)
    colours = "with colours" if "displayColor" in data.attributes else "without colours"
    counts = f"{len(data.curves):,} curves of {len(data.points):,} points"
    return f"{curves.name}: {counts}, radii {radii.min():.6g} to {radii.max():.6g}, {colours}"


def main(arguments):
    """Open a file, print what it holds, and save it as .blend if a second argument names one."""
    for curves in open_beams(arguments[0]):
        print(told(curves))
    if len(arguments) > 1:
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(arguments[1]).absolute()))


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
