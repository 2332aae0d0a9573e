"""Render one picture by Blender's Cycles: `python cycles_worker.py JOB.json`, by the Python that has `bpy`.

The job is what `cycles.job` returns. The picture is written to its `file` as EXR; the last line of the output is a JSON
object with the seconds of the render and the seconds of processor time. Nothing of photonbeams is needed.
"""

import json
import sys
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import bpy
from mathutils import Vector


def material(name: str, fog: dict[str, Any] | None = None) -> Any:
    """Return a black surface, with fog behind it where that is given."""
    made = bpy.data.materials.new(name)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output, black = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
    black.inputs["Color"].default_value = (0, 0, 0, 1)
    links.new(black.outputs[0], output.inputs["Surface"])
    if fog is not None:
        volume = nodes.new("ShaderNodeVolumeCoefficients")
        volume.phase = "HENYEY_GREENSTEIN"
        volume.inputs["Scatter Coefficients"].default_value = fog["scattering"]
        volume.inputs["Absorption Coefficients"].default_value = fog["absorption"]
        volume.inputs["Anisotropy"].default_value = fog["anisotropy"]
        links.new(volume.outputs[0], output.inputs["Volume"])
        made.cycles.volume_sampling = "EQUIANGULAR"  # has the least error here: the default has a quarter more
    return made


def build(scene: Any, job: dict[str, Any]) -> None:
    """Add the walls, the fog in the first of them, the light and the camera."""
    for index, (points, faces) in enumerate(job["meshes"]):
        mesh = bpy.data.meshes.new(f"mesh {index}")
        mesh.from_pydata(points, [], faces)
        mesh.materials.append(material(mesh.name, job["fog"] if index == 0 else None))
        scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))
    given = job["light"]
    light = bpy.data.lights.new("light", "AREA")
    light.shape, light.size, light.energy = "SQUARE", given["side"], given["power"]
    lamp = bpy.data.objects.new("light", light)
    lamp.location = given["center"]
    lamp.rotation_euler = Vector(given["axis"]).to_track_quat("-Z", "Y").to_euler()
    camera = bpy.data.cameras.new("camera")
    camera.angle, camera.clip_start = job["camera"]["angle"], 1e-4
    eye = bpy.data.objects.new("camera", camera)  # looks along −z, with +y up
    eye.location = job["camera"]["eye"]
    for each in (lamp, eye):
        scene.collection.objects.link(each)
    scene.camera = eye


def set_up(scene: Any, job: dict[str, Any]) -> None:
    """Set what Cycles needs to converge to the true picture: no clamping, no light left out, a box filter."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", job["samples"]
    cycles.use_adaptive_sampling, cycles.use_denoising = False, True
    cycles.denoiser, cycles.denoising_use_gpu = "OPENIMAGEDENOISE", False
    cycles.max_bounces, cycles.volume_bounces = 1024, job["bounces"]
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0
    cycles.pixel_filter_type = "BOX"
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *job["size"], 100
    render.filepath = job["file"]
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    build(scene, job)
    set_up(scene, job)
    scene.render.resolution_percentage = 5
    bpy.ops.render.render()  # warms up: loads kernels and the denoiser's weights
    scene.render.resolution_percentage = 100
    begin, cpu = perf_counter(), process_time()
    bpy.ops.render.render()
    spent = {"seconds": perf_counter() - begin, "processor": process_time() - cpu}
    bpy.data.images["Render Result"].save_render(job["file"], scene=scene)
    print("\n" + json.dumps(spent), flush=True)


if __name__ == "__main__":
    main()
