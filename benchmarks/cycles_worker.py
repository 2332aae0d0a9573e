"""Render pictures with Blender's Cycles: `python cycles_worker.py JOB.json`, with a Python that has `bpy`.

The job has the form that `cycles_scene.cycles_job` returns, plus `size`, `bounces`, `samples`, `files` and `limit`. One
picture is rendered for each number of samples and written as EXR, until a picture takes more than `limit` seconds. For
each picture a line of the output is a JSON object with its seconds, its seconds of processor time and its samples.
Nothing of photonbeams is needed.
"""

import json
import sys
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import bpy
from mathutils import Matrix, Vector


def material(name: str) -> Any:
    """Return a material with no node but its output."""
    made = bpy.data.materials.new(name)
    made.node_tree.nodes.clear()
    made.node_tree.nodes.new("ShaderNodeOutputMaterial")
    return made


def connect(made: Any, node: Any, socket: str) -> None:
    """Make a node the surface or the volume of a material."""
    made.node_tree.links.new(node.outputs[0], made.node_tree.nodes["Material Output"].inputs[socket])


def surface(name: str, given: dict[str, Any]) -> Any:
    """Return a diffuse surface or glass, by `kind`; `emission` is the radiance of its front."""
    made = material(name)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    if given["kind"] == "diffuse":
        node = nodes.new("ShaderNodeBsdfDiffuse")
        node.inputs["Color"].default_value = (*given["color"], 1)
    else:
        node = nodes.new("ShaderNodeBsdfGlass")
        node.inputs["Roughness"].default_value, node.inputs["IOR"].default_value = 0, given["ior"]
    if "emission" in given:
        scattering, strength = node, max(given["emission"])
        node, shining, side, front = (
            nodes.new(f"ShaderNode{kind}") for kind in ("AddShader", "Emission", "NewGeometry", "MapRange")
        )
        front.inputs["To Min"].default_value, front.inputs["To Max"].default_value = strength, 0
        links.new(side.outputs["Backfacing"], front.inputs["Value"])
        links.new(front.outputs[0], shining.inputs["Strength"])
        shining.inputs["Color"].default_value = (*(each / strength for each in given["emission"]), 1)
        links.new(scattering.outputs[0], node.inputs[0])
        links.new(shining.outputs[0], node.inputs[1])
        made.cycles.emission_sampling = "FRONT"
    connect(made, node, "Surface")
    return made


def fog(name: str, given: dict[str, Any]) -> Any:
    """Return the material of a homogeneous medium, with a transparent surface."""
    made = material(name)
    nodes = made.node_tree.nodes
    volume = nodes.new("ShaderNodeVolumeCoefficients")
    volume.phase = "HENYEY_GREENSTEIN"
    volume.inputs["Scatter Coefficients"].default_value = given["scattering"]
    volume.inputs["Absorption Coefficients"].default_value = given["absorption"]
    volume.inputs["Anisotropy"].default_value = given["anisotropy"]
    connect(made, volume, "Volume")
    connect(made, nodes.new("ShaderNodeBsdfTransparent"), "Surface")
    made.cycles.volume_sampling = "EQUIANGULAR"  # has the least error: the default's is a quarter larger
    return made


def add_mesh(scene: Any, name: str, given: dict[str, Any], made: Any) -> None:
    """Add a mesh with a material."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(given["points"], [], given["faces"])
    mesh.polygons.foreach_set("use_smooth", [bool(given.get("smooth"))] * len(mesh.polygons))
    mesh.materials.append(made)
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def build(scene: Any, job: dict[str, Any]) -> None:
    """Add surfaces, media, an area light if there is one, the background and the camera."""
    for index, given in enumerate(job["surfaces"]):
        add_mesh(scene, f"surface {index}", given, surface(f"surface {index}", given))
    for index, given in enumerate(job["fogs"]):
        add_mesh(scene, f"fog {index}", given, fog(f"fog {index}", given["fog"]))
    if given := job.get("light"):
        light = bpy.data.lights.new("light", "AREA")
        light.shape, light.size, light.energy = "SQUARE", given["side"], given["power"]
        lamp = bpy.data.objects.new("light", light)
        lamp.location = given["center"]
        lamp.rotation_euler = Vector(given["axis"]).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
    world = bpy.data.worlds.new("world")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*job["background"], 1)
    scene.world = world
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle, camera.clip_start = "HORIZONTAL", job["camera"]["angle"], 1e-4
    eye = bpy.data.objects.new("camera", camera)
    eye.matrix_world = Matrix(job["camera"]["matrix"])
    scene.collection.objects.link(eye)
    scene.camera = eye


def set_up(scene: Any, job: dict[str, Any]) -> None:
    """Set what Cycles needs to converge to the true picture: no clamping, no light left out, a box filter."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling, cycles.use_denoising = False, True
    cycles.denoiser, cycles.denoising_use_gpu = "OPENIMAGEDENOISE", False
    cycles.max_bounces = cycles.transparent_max_bounces = 1024
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 1024
    cycles.volume_bounces = job["bounces"]
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0
    cycles.blur_glossy = 0
    cycles.pixel_filter_type = "BOX"
    render = scene.render
    render.resolution_x, render.resolution_y = job["size"]
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    build(scene, job)
    set_up(scene, job)
    scene.cycles.samples, scene.render.resolution_percentage = job["samples"][0], 5
    bpy.ops.render.render()  # warms up: loads kernels and the denoiser's weights
    scene.render.resolution_percentage = 100
    for samples, file in zip(job["samples"], job["files"], strict=True):
        scene.cycles.samples = samples
        begin, cpu = perf_counter(), process_time()
        bpy.ops.render.render()
        spent = {"seconds": perf_counter() - begin, "processor": process_time() - cpu, "samples": samples}
        bpy.data.images["Render Result"].save_render(file, scene=scene)
        print("\n" + json.dumps(spent), flush=True)
        if spent["seconds"] > job["limit"]:
            break


if __name__ == "__main__":
    main()
