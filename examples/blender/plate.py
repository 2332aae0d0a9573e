r"""Render the attic in Blender's Cycles, as a plate for beams: picture and depth in one layered EXR.

Run it with Blender 5.0.1, or with the Python that has Blender as a module (`pip install bpy==5.0.1`, Python 3.11):

    blender --background --factory-startup --python examples/blender/plate.py
    python examples/blender/plate.py
    python examples/blender/plate.py -- large.exr 1280    # a file's name and a width: larger, denoised

`plate.exr` is committed. photonbeams takes the camera from the exported stage:

    photonbeams render examples/blender/attic.usda --scattering 0.05 --holdout examples/blender/plate.exr \
        --over examples/blender/plate.exr -o out.png
"""

import sys
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
PLATE, WIDTH, SAMPLES = HERE / "plate.exr", 320, 256


def set_up(scene, width):
    """Set Cycles on the processor, with the Z pass beside the picture."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = width != WIDTH  # the committed plate is the tests', too
    scene.cycles.samples = SAMPLES // 4 if scene.cycles.use_denoising else SAMPLES
    scene.render.resolution_x, scene.render.resolution_y = width, width * 9 // 16
    scene.view_layers[0].use_pass_z = True
    settings = scene.render.image_settings
    settings.media_type, settings.file_format = "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER"
    settings.color_depth, settings.exr_codec = "16", "DWAA"  # the depth is in single precision all the same


if __name__ == "__main__":
    sys.path.insert(0, str(HERE))
    from make_stage import model

    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    path, width = given or (PLATE, WIDTH)
    model()
    set_up(bpy.context.scene, int(width))
    bpy.context.scene.render.filepath = str(Path(path).resolve())
    bpy.ops.render.render(write_still=True)
