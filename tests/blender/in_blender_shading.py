"""Runs in Blender's Python: nodes, skies, glowing meshes and fog in objects, beside Cycles where it is the oracle.

python -I in_blender_shading.py CASE[,CASE...] FOLDER
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src" / "photonbeams" / "blender"))

import bpy
import numpy as np
from extension.reading.kept import Kept
from extension.reading.nodes import value_of
from extension.reading.scene import SceneReader
from extension.reading.shading.calls import Points
from extension.reading.shading.evaluation import evaluated
from extension.reading.shading.links import source_of
from extension.reading.shading.materials import surface_of
from extension.reading.shading.skies import SkyReader
from in_blender import run, tell


def empty():
    """Return an empty scene with a black world."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def add(tree, kind, link=None, **inputs):
    """Add a node with values of its inputs; an output as a value is linked."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for key, value in inputs.items():
        socket = node.inputs[int(key[1:])] if key[0] == "_" else node.inputs[key]
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def principled(name="Made"):
    """Return a new material's tree, and its Principled BSDF."""
    tree = bpy.data.materials.new(name).node_tree
    return tree, tree.nodes["Principled BSDF"]


def read(folder):
    """Return the prims of the scene, and what is told."""
    said = []
    prims = SceneReader(bpy.context.evaluated_depsgraph_get(), Kept(str(folder)), said.append).prims()
    return prims, said


def cycles(path, width, height):
    """Render the scene with Cycles; return its pixels (H, W, 4) from the top row down."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 16, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.render.resolution_x, scene.render.resolution_y = width, height
    settings = scene.render.image_settings
    settings.media_type, settings.file_format, settings.color_depth = "IMAGE", "OPEN_EXR", "32"
    settings.color_mode = "RGBA"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:]).reshape(height, width, -1)[::-1]
    bpy.data.images.remove(image)
    return pixels


def values(folder):
    """Print values of inputs that nodes make."""
    empty()
    tree, shader = principled()
    inside = bpy.data.node_groups.new("Halved", "ShaderNodeTree")
    inside.interface.new_socket("Value", in_out="INPUT", socket_type="NodeSocketFloat")
    inside.interface.new_socket("Result", in_out="OUTPUT", socket_type="NodeSocketFloat")
    ends = inside.nodes.new("NodeGroupInput"), inside.nodes.new("NodeGroupOutput")
    half = add(inside, "Math", _0=ends[0].outputs[0], _1=0.5)
    half.operation = "MULTIPLY"
    inside.links.new(half.outputs[0], ends[1].inputs[0])

    def halved(value):
        group = tree.nodes.new("ShaderNodeGroup")
        group.node_tree = inside
        if isinstance(value, float):
            group.inputs[0].default_value = value
        else:
            tree.links.new(value, group.inputs[0])
        return group.outputs[0]

    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs[0].default_value = 0.5
    mix.inputs[6].default_value, mix.inputs[7].default_value = (0.8, 0.4, 0.2, 1), (0.5, 0.5, 1.0, 1)
    ramp = add(tree, "ValToRGB", _0=0.25)
    ramp.color_ramp.elements[1].color = (1, 0.5, 0, 1)
    place = tree.nodes.new("ShaderNodeTexCoord")
    apart = add(tree, "SeparateXYZ", _0=place.outputs["Generated"])
    cases = {
        "group in a group": halved(halved(0.6)), "mix": mix.outputs[2], "ramp": ramp.outputs[0],
        "hue": add(tree, "HueSaturation", Hue=0.5 + 1 / 3, Color=(0.9, 0.3, 0.3, 1)).outputs[0],
        "gamma": add(tree, "Gamma", _0=(0.5, 0.25, 1, 1), _1=2.0).outputs[0],
        "linear": apart.outputs[2],
    }  # fmt: skip
    found, said = {}, []
    for name, output in cases.items():
        socket = shader.inputs["Base Color" if output.type == "RGBA" else "Roughness"]
        tree.links.new(output, socket)
        found[name] = value_of(shader, socket.name, said.append)
    for name, level in (("weak", 0.25), ("strong", 1.0)):
        shader = principled(name)[1]
        shader.inputs["Specular IOR Level"].default_value = level
        shader.inputs["Specular Tint"].default_value = (1, 0.5, 0, 1)
        found[name] = surface_of(bpy.data.materials[name], 1.0, said.append)
    tell(values=found, said=said)


def noise(folder):
    """Evaluate a Noise Texture where Cycles shows it, and print the largest difference."""
    scene = empty()
    bpy.ops.mesh.primitive_plane_add(size=2)
    tree, _ = principled()
    place = tree.nodes.new("ShaderNodeTexCoord")
    texture = add(tree, "TexNoise", Scale=3.0, Detail=2.5, Roughness=0.6, Vector=place.outputs["Object"])
    light = add(tree, "Emission", Color=texture.outputs["Color"])
    tree.links.new(light.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    bpy.context.object.data.materials.append(bpy.data.materials["Made"])
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (0, 0, 1)
    scene.collection.objects.link(scene.camera)
    size = 16
    shown = cycles(folder / "noise.exr", size, size)[..., 0]  # the first of three noises is the texture's Factor
    middles = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(middles, -middles)
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    expected = evaluated(source_of(light.inputs["Color"]), Points(points, points, points, points))
    tell(difference=float(np.abs(expected[:, 0].reshape(size, size) - shown).max()), spread=float(np.ptp(shown)))


def skies(folder):
    """Print the irradiance of the ground under skies, here and by Cycles, and of their suns."""
    scene = empty()
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.panorama_type = "PANO", "EQUIRECTANGULAR"
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.rotation_euler = (math.pi / 2, 0, math.pi / 2)  # to −X, the middle of Environment Textures
    scene.collection.objects.link(scene.camera)
    tree = scene.world.node_tree
    background = tree.nodes["Background"]
    sky = tree.nodes.new("ShaderNodeTexSky")
    place = tree.nodes.new("ShaderNodeTexCoord")
    up = add(tree, "SeparateXYZ", _0=place.outputs["Generated"])
    ramp = add(tree, "ValToRGB", _0=up.outputs[2])
    ramp.color_ramp.elements[0].color = (0.1, 0.2, 0.5, 1)
    height = 32
    rows = math.pi * (0.5 - (np.arange(height) + 0.5) / height)
    weights = (np.cos(rows) * np.maximum(np.sin(rows), 0))[:, None, None] * math.pi**2 / height**2
    for name, output, kind, extra in (
        ("low sun", sky, "SINGLE_SCATTERING", {"sun_elevation": 0.1}),
        ("high sun", sky, "SINGLE_SCATTERING", {"sun_elevation": 1.0, "sun_rotation": 1.2}),
        ("haze", sky, "SINGLE_SCATTERING", {"aerosol_density": 4.0}), ("many", sky, "MULTIPLE_SCATTERING", {}),
        ("preetham", sky, "PREETHAM", {"turbidity": 3.0, "sun_direction": (0.6, 0.3, 0.5)}),
        ("hosek", sky, "HOSEK_WILKIE", {}), ("ramp", ramp, None, {}),
    ):  # fmt: skip
        sky.sun_disc = False
        if kind:
            sky.sky_type = kind
        for key, value in extra.items():
            setattr(sky, key, value)
        tree.links.new(output.outputs[0], background.inputs["Color"])
        background.inputs["Strength"].default_value = 0.5
        source = source_of(tree.nodes["World Output"].inputs["Surface"])
        said = []
        own = SkyReader(said.append).radiance(source)
        own = own.reshape(height, own.shape[0] // height, 2 * height, -1, 3).mean(axis=(1, 3))
        shown = cycles(folder / "sky.exr", 2 * height, height)[..., :3]
        sky.sun_disc = True
        reader = SkyReader(said.append)
        reader.radiance(source)
        sun = [each.values["inputs:color"] for each in reader.suns]
        peaks = [int(each[:15].sum(axis=(0, 2)).argmax()) for each in (own, shown)]
        own, shown = ((each * weights).sum(axis=(0, 1)).tolist() for each in (own, shown))
        tell(sky=name, own=own, cycles=shown, sun=sun, peaks=peaks, said=said)


def glow(folder):
    """Print which glowing meshes are lamps, and what of them."""
    scene = empty()
    for k in range(10):
        _, shader = principled(f"Glow{k}")
        shader.inputs["Emission Strength"].default_value = 1.0 + k
        shader.inputs["Emission Color"].default_value = (1, 0.5, 0.25, 1)
        bpy.ops.mesh.primitive_cube_add(size=1, location=(3 * k, 0, 0), scale=(1, 1, 2))
        bpy.context.object.name = f"Cube{k}"
        bpy.context.object.data.materials.append(bpy.data.materials[f"Glow{k}"])
    bpy.data.objects["Cube9"].visible_camera = False
    bpy.data.objects["Cube8"].scale = (0.1, 0.1, 0.1)
    scene.view_layers[0].update()
    prims, said = read(folder)
    meshes = {each["path"]: each for each in prims if each["type"] == "Mesh"}
    lamps = [path for path, each in meshes.items() if each["values"].get("photonbeams:enabled", [0, 0])[1]]
    unseen = meshes["/Objects/Cube9"]
    tell(lamps=lamps, unseen=not unseen["values"]["visibleInPrimaryRay"][1], apis=unseen["apis"], said=said)


def fog(folder):
    """Print the prims of fog in objects: even in a ball, and one that grows with the height in a box."""
    empty()
    for name, add_mesh in (("Ball", bpy.ops.mesh.primitive_uv_sphere_add), ("Box", bpy.ops.mesh.primitive_cube_add)):
        add_mesh()
        bpy.context.object.name = name
        made = bpy.data.materials.new(name)
        bpy.context.object.data.materials.append(made)
        tree = made.node_tree
        tree.nodes.remove(tree.nodes["Principled BSDF"])
        volume = add(tree, "VolumePrincipled", Density=0.4, Color=(0.5, 0.25, 1.0, 1))
        tree.links.new(volume.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
        if name == "Box":
            place = tree.nodes.new("ShaderNodeTexCoord")
            up = add(tree, "SeparateXYZ", _0=place.outputs["Generated"])
            tree.links.new(up.outputs[2], volume.inputs["Density"])
    prims, said = read(folder)
    found = {each["path"]: each for each in prims}
    file = found["/Objects/Box/Density"]["values"]["filePath"][1]
    (shader,) = (each for path, each in found.items() if path.startswith("/Objects/Ball/") and each["type"] == "Shader")
    ball, box = shader["values"]["inputs:scattering"][1], found["/Objects/Box"]["values"]["photonbeams:scattering"][1]
    tell(types={path: each["type"] for path, each in found.items()}, file=file, ball=ball, box=box, said=said)


def image(name, values):
    """Return an image (H, W, 3) of numbers that are no colours."""
    height, width = values.shape[:2]
    made = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    made.pixels.foreach_set(np.concatenate([values, np.ones((height, width, 1))], axis=-1).astype(np.float32).ravel())
    made.pack()
    return made


def bumps(folder):
    """Print the light of the four quarters of planes that are bumped, here and by Cycles."""
    scene = empty()
    across = np.abs(2 * (np.arange(64) + 0.5) / 64 - 1)  # a ridge along v
    heights, ridge = np.broadcast_to(across[None, :, None], (64, 64, 3)), np.sign(np.linspace(-1, 1, 64))
    tilted = np.broadcast_to(
        np.stack([0.5 + 0.2 * ridge, 0.5 + 0 * ridge, 0 * ridge + 0.5 + 0.21**0.5], -1), (64, 64, 3)
    )
    images = {"Along": image("Along", heights), "Across": image("Across", heights.swapaxes(0, 1)),
              "Normals": image("Normals", tilted)}  # fmt: skip

    def texture(tree, name):
        made = tree.nodes.new("ShaderNodeTexImage")
        made.image = images[name]
        return made.outputs["Color"]

    def matt(tree):
        return tree.nodes["Diffuse BSDF"]

    def bump(tree, name, **inputs):
        return add(tree, "Bump", Height=texture(tree, name), **{"Strength": 1.0, **inputs})

    def inverted(tree):
        node = bump(tree, "Along", Distance=0.3, Strength=0.4)
        node.invert = True
        return node

    def on_another_layer(tree):
        layer = tree.nodes.new("ShaderNodeUVMap")
        layer.uv_map = "Turned"
        node = bump(tree, "Along", Distance=0.3)
        tree.links.new(layer.outputs[0], node.inputs["Height"].links[0].from_node.inputs["Vector"])
        return node

    def of_nodes(tree):
        ramp = add(tree, "ValToRGB", _0=texture(tree, "Along"))
        ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (1, 1, 1, 1), (0, 0, 0, 1)
        both = tree.nodes.new("ShaderNodeMix")
        both.data_type = "RGBA"
        for socket, output in ((both.inputs[6], ramp.outputs[0]), (both.inputs[7], texture(tree, "Across"))):
            tree.links.new(output, socket)
        tree.links.new(add(tree, "Gamma", _0=both.outputs[2], _1=2.0).outputs[0], matt(tree).inputs["Color"])
        return add(tree, "Bump", Height=ramp.outputs[0], Distance=0.3, Strength=1.0)

    cases = {
        "bump": lambda tree: bump(tree, "Along", Distance=0.3),
        "weak": inverted,
        "chained": lambda tree: bump(tree, "Across", Distance=0.2,
                                     Normal=bump(tree, "Along", Distance=0.3).outputs[0]),
        "normals": lambda tree: add(tree, "NormalMap", Color=texture(tree, "Normals"), Strength=0.5),
        "displaced": lambda tree: add(tree, "Displacement", Height=texture(tree, "Along"), Scale=0.3),
        "layer": on_another_layer,
        "nodes": of_nodes,
    }  # fmt: skip
    for k, (name, make) in enumerate(cases.items()):
        bpy.ops.mesh.primitive_plane_add(size=1, location=(2 * k, 0, 0))
        plane, (tree, _) = bpy.context.object, principled(name)
        plane.scale = (2, 2, 2)
        plane.data.materials.append(bpy.data.materials[name])
        turned = plane.data.uv_layers.new(name="Turned")
        for place, each in enumerate(plane.data.uv_layers[0].uv):
            turned.uv[place].vector = each.vector.yx
        output = tree.nodes["Material Output"]
        tree.links.new(add(tree, "BsdfDiffuse", Color=(0.5, 0.5, 0.5, 1)).outputs[0], output.inputs["Surface"])
        made, into = make(tree), output.inputs["Displacement"] if name == "displaced" else matt(tree).inputs["Normal"]
        tree.links.new(made.outputs[0], into)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 3.0, 0.0
    lamp = bpy.data.objects.new("Sun", sun)
    lamp.rotation_euler = (0.3, 0.7, 0)
    scene.collection.objects.link(lamp)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2 * len(cases)
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (len(cases) - 1, 0, 3)
    scene.collection.objects.link(scene.camera)
    for name, picture in both(folder, 16 * len(cases), 16).items():
        quarters = picture[..., :3].reshape(2, 8, len(cases), 2, 8, 3)[:, 2:6, :, :, 2:6].mean(axis=(1, 4, 5))
        tell(engine=name, quarters=dict(zip(cases, quarters.transpose(1, 0, 2).tolist(), strict=True)))
    tell(said=read(folder)[1])


def rays(folder):
    """Print the light of a floor and two things that some rays do not meet, here and by Cycles."""
    scene = empty()
    scene.world = None
    for name, place, size in (("Floor", (0, 0, 0), 12), ("Left", (-1.2, 0, 0.6), 1.2), ("Right", (1.2, 0, 0.6), 1.2)):
        add_mesh = bpy.ops.mesh.primitive_plane_add if name == "Floor" else bpy.ops.mesh.primitive_cube_add
        add_mesh(size=size, location=place)
        bpy.context.object.name = name
        tree, _ = principled(name)
        matt = add(tree, "BsdfDiffuse", Color=(0.5, 0.5, 0.5, 1))
        tree.links.new(matt.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        bpy.context.object.data.materials.append(bpy.data.materials[name])
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.data.energy, lamp.data.shadow_soft_size, lamp.location = 300.0, 0.1, (-0.4, -2, 3)
    camera = bpy.data.cameras.new("Camera")
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 4), (math.radians(55), 0, 0)
    for each in (lamp, scene.camera):
        scene.collection.objects.link(each)
    left, right = bpy.data.objects["Left"], bpy.data.objects["Right"]
    inner = bpy.data.collections.new("Inner")
    scene.collection.children.link(inner)
    inner.objects.link(right)
    scene.collection.objects.unlink(right)
    indirect = scene.view_layers[0].layer_collection.children["Inner"]
    scene.render.film_transparent = True
    cases = {
        "plain": (), "camera": ((left, "visible_camera", False),), "shadow": ((left, "visible_shadow", False),),
        "holdout": ((left, "is_holdout", True),), "indirect": ((indirect, "indirect_only", True),),
    }  # fmt: skip
    for name, settings in cases.items():
        for thing, key, value in settings:
            setattr(thing, key, value)
        for engine, picture in both(folder, 48, 28).items():
            blocks = picture.reshape(4, 7, 6, 8, 4).mean(axis=(1, 3))
            tell(case=name, engine=engine, blocks=blocks.tolist())
        for thing, key, value in settings:
            setattr(thing, key, not value)


def glowing_fog(folder):
    """Print the light of glowing fog in a cube with a clear surface, or everywhere, here and by Cycles."""
    scene = empty()
    bpy.ops.mesh.primitive_cube_add(size=2)
    tree, _ = principled()
    bpy.context.object.data.materials.append(bpy.data.materials["Made"])
    fog = add(tree, "VolumePrincipled", Density=0.5, Color=(0, 0, 0, 1))
    fog.inputs["Emission Strength"].default_value, fog.inputs["Emission Color"].default_value = 0.3, (1, 0.5, 0.25, 1)
    output = tree.nodes["Material Output"]
    tree.links.new(fog.outputs[0], output.inputs["Volume"])
    tree.links.new(add(tree, "BsdfTransparent").outputs[0], output.inputs["Surface"])
    world = scene.world.node_tree
    shine, stop = add(world, "Emission", Strength=0.2), add(world, "VolumeAbsorption", Density=0.25, Color=(0, 0, 0, 1))
    both_of = add(world, "AddShader", _0=shine.outputs[0], _1=stop.outputs[0])
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 1.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (0, 0, 3)
    scene.collection.objects.link(scene.camera)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.data.energy, lamp.location = 1e-6, (9, 9, 9)
    scene.collection.objects.link(lamp)
    for place in ("cube", "world"):
        for engine, picture in both(folder, 8, 8).items():
            light = picture[..., :3].mean(axis=(0, 1)).tolist()
            tell(place=place, engine=engine, light=light, said=read(folder)[1])
        world.links.new(both_of.outputs[0], world.nodes["World Output"].inputs["Volume"])
        bpy.data.objects["Cube"].hide_render = True


def both(folder, width, height, **settings):
    """Return the scene's picture (H, W, 4) here and by Cycles, whose paths do not go on."""
    scene = bpy.context.scene
    scene.cycles.max_bounces = 0
    found = {"Cycles": cycles(folder / "cycles.exr", width, height)}
    own = scene.photonbeams
    scene.render.engine, own.denoise, own.bounces = "PHOTONBEAMS", False, 0
    own.passes, own.beams = 32, 256
    for name, value in settings.items():
        setattr(own, name, value)
    scene.render.filepath = str(folder / "own.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    found["own"] = np.array(picture.pixels[:]).reshape(height, width, -1)[::-1]
    bpy.data.images.remove(picture)
    return found


if __name__ == "__main__":
    run(values, noise, skies, glow, fog, bumps, rays, glowing_fog)
