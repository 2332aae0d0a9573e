"""Runs in Blender's Python, as `in_blender.py` does: what moves while the shutter is open.

python -I moving.py CASE[,CASE...] FOLDER
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
import hair
from in_blender import render, room, run, tell


def keys(thing, name, *values):
    """Animate a property linearly, from frame 1 on."""
    for frame, value in enumerate(values, start=1):
        setattr(thing, name, value)
        thing.keyframe_insert(name, frame=frame)
    for strip in (thing.id_data.animation_data).action.layers[0].strips:
        for curve in (curve for bag in strip.channelbags for curve in bag.fcurves):
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"


def moving_room():
    """Build a room in which a thing, another's shape, a lamp, the camera and its lens move linearly."""
    scene = room()
    box, twin, key, camera = (bpy.data.objects[name] for name in ("Cube", "Twin", "Key", "Camera"))
    keys(box, "location", (0.0, 1, 0.4), (0.6, 1, 0.4), (1.2, 1, 0.4))
    twin.data = twin.data.copy()
    twin.shape_key_add(name="Basis")
    raised = twin.shape_key_add(name="Raised")
    for point in raised.data:
        point.co.z *= 3
    keys(raised, "value", 0.0, 0.5, 1.0)
    keys(key, "location", (-2.5, 0.5, 3), (-1, 0.5, 3), (0.5, 0.5, 3))
    keys(camera, "location", (0.5, -5.2, 1.6), (0.5, -5, 1.6), (0.5, -4.8, 1.6))
    keys(camera.data, "lens", 45.0, 50.0, 55.0)
    scene.frame_start, scene.frame_end = 1, 3
    scene.frame_set(2)
    shutter(scene)
    return scene


def shutter(scene, frames=1.0, position="CENTER"):
    """Open the shutter."""
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter, scene.render.motion_blur_position = frames, position
    scene.photonbeams.passes = 4


def frame(folder):
    """Render a frame, export the animation as Blender does, and tell which frame it is."""
    scene = moving_room()
    render(folder / "frame.exr")
    tell(frame=scene.frame_current + scene.frame_subframe)
    scene.world = None  # its volume hides its sky, as in Cycles; a stage's fog does not
    bpy.ops.wm.usd_export(filepath=str(folder / "frame.usdc"), evaluation_mode="RENDER", export_animation=True)


def still(folder):
    """Render a frame in which nothing moves, with and without a shutter."""
    scene = room()
    scene.photonbeams.passes = 4
    render(folder / "without.exr")
    shutter(scene)
    scene.photonbeams.passes = 4
    render(folder / "with.exr")


def eyes(folder):
    """Render two eyes, and a border of them."""
    scene = moving_room()
    scene.photonbeams.passes = 2
    scene.render.use_multiview = True
    scene.camera.data.stereo.interocular_distance = 0.4
    render(folder / "whole.exr")
    scene.render.use_border = scene.render.use_crop_to_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 1 / 3, 1.0
    render(folder / "part.exr")


def samples(folder):
    """Tell the time samples of things that turn, are copied, change their faces, and are not blurred; of a lens."""
    from extension.reading.kept import Kept
    from extension.reading.motion import shutter_of, with_samples
    from extension.reading.scene import SceneReader

    scene = room()
    keys(bpy.data.objects["Cube"], "rotation_euler", (0, 0, 0), (0, 0, math.radians(150)))
    keys(bpy.data.lights["Fill"], "shadow_soft_size", 0.1, 0.3)
    group = bpy.data.collections.new("Group")
    copied = bpy.data.objects.new("Copied", bpy.data.objects["Cube"].data)
    group.objects.link(copied)
    holder = bpy.data.objects.new("Holder", None)
    holder.instance_type, holder.instance_collection = "COLLECTION", group
    scene.collection.objects.link(holder)
    keys(holder, "location", (0, 0, 0), (2, 0, 0))
    bpy.ops.mesh.primitive_cube_add()
    growing = bpy.context.object
    growing.name = "Growing"
    keys(growing.modifiers.new("Array", "ARRAY"), "count", 1, 5)
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = "Unblurred"
    keys(bpy.context.object, "location", (0, 0, 0), (2, 0, 0))
    bpy.context.object.cycles.use_motion_blur = False
    mist = bpy.data.objects.new("Mist", bpy.data.volumes.new("Mist"))
    mist.modifiers.new("Mist", "MESH_TO_VOLUME").object = copied
    grass = hair.lawn()
    for each in (mist, grass):
        keys(each, "location", (0, 0, 0), (2, 0, 0))
    scene.collection.objects.link(mist)
    shutter(scene, 1.0, "START")
    points = scene.render.motion_blur_shutter_curve.curves[0].points
    points[0].location = (0, 0)
    scene.frame_set(1)
    said = []
    graph = bpy.context.evaluated_depsgraph_get()
    reader, closed = SceneReader(graph, Kept(str(folder)), said.append), shutter_of(scene, said.append)
    prims, moved = reader.prims(), {}
    for each in closed.other_times():
        scene.frame_set(math.floor(each), subframe=each % 1)
        moved[each] = reader.moved()
    scene.frame_set(1)
    sampled = [
        with_samples(
            each,
            closed.frame,
            {time: found[each["path"]] for time, found in moved.items() if each["path"] in found},
            said.append,
        )
        for each in prims
    ]
    tell(
        times=closed.other_times(),
        said=said,
        samples={
            each["path"]: {
                name: [[time, value.tolist() if hasattr(value, "tolist") else value] for time, value in found]
                for name, found in each["samples"].items()
            }
            for each in sampled
            if "samples" in each
        },
    )


if __name__ == "__main__":
    run(frame, still, eyes, samples)
