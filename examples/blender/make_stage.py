"""Model a small attic in Blender and export it as `attic.usda`: a stage without anything of photonbeams in it.

Run it with Blender 5.0.1, or with the Python that has Blender as a module (`pip install bpy==5.0.1`, Python 3.11):

    blender --background --factory-startup --python examples/blender/make_stage.py
    python examples/blender/make_stage.py

The exported stage is committed. It has no fog, so the command line adds one:

    photonbeams render examples/blender/attic.usda --scattering 0.05 -o out.png
"""

import math
import random
from pathlib import Path

import bpy
from mathutils import Vector

STAGE = Path(__file__).resolve().with_name("attic.usda")
RIDGE, EAVES, HALF_WIDTH, HALF_LENGTH = 3.1, 0.7, 2.4, 2.8  # metres
SKYLIGHT = ((0.45, 1.2), (-0.25, 0.75))  # metres down the slope from the ridge, and along y


def material(name, color, roughness=0.7, metallic=0.0):
    """Return a Principled material, which the exporter turns into a UsdPreviewSurface."""
    result = bpy.data.materials.new(name)
    shader = result.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    return result


def mesh(name, points, faces, look):
    """Add a mesh object."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(points, [], faces)
    data.materials.append(look)
    result = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(result)
    return result


def box(name, low, high, look, bevel=0.0):
    """Add a box between two corners."""
    center = (Vector(low) + Vector(high)) / 2
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=center)
    result = bpy.context.object
    result.name = result.data.name = name
    result.scale = Vector(high) - Vector(low)
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    result.data.materials.append(look)
    if bevel:
        modifier = result.modifiers.new("Bevel", "BEVEL")
        modifier.width, modifier.segments = bevel, 1
    return result


def roof(look):
    """Add the two slopes, one with a hole for the skylight, and the gable behind."""
    w, h, y = HALF_WIDTH, RIDGE, HALF_LENGTH
    mesh("RoofRight", [(0, -y, h), (w, -y, EAVES), (w, y, EAVES), (0, y, h)], [(0, 1, 2, 3)], look)

    def left(down, along):
        return (-w * down, along, h + (EAVES - h) * down)

    (top, bottom), (near, far) = SKYLIGHT
    length = math.hypot(w, h - EAVES)
    rows, columns = (0, top / length, bottom / length, 1), (-y, near, far, y)
    points = [left(down, along) for down in rows for along in columns]
    cells = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    faces = [(4 * i + j, 4 * i + j + 1, 4 * i + j + 5, 4 * i + j + 4) for i, j in cells]
    mesh("RoofLeft", points, faces, look)
    gable = [(-w, y, -0.05), (w, y, -0.05), (w, y, EAVES), (0, y, h), (-w, y, EAVES)]
    mesh("Gable", gable, [(0, 4, 3, 2, 1)], look)
    for side in (-1, 1):
        knee = [(side * w, -y, -0.05), (side * w, y, -0.05), (side * w, y, EAVES), (side * w, -y, EAVES)]
        mesh("KneeWall", knee, [(0, 1, 2, 3)], look)


def timber(look):
    """Add rafters, the collar beams and the skylight's bars, which cut the light into shafts."""
    slope = math.atan2(RIDGE - EAVES, HALF_WIDTH)
    length = math.hypot(HALF_WIDTH, RIDGE - EAVES)
    for y in (-1.9, -0.9, 1.35, 2.3):
        for side in (-1, 1):
            rafter = box("Rafter", (-length / 2, -0.06, -0.14), (length / 2, 0.06, -0.01), look)
            rafter.rotation_euler = (0, side * slope, 0)
            rafter.location = (side * HALF_WIDTH / 2, y, (RIDGE + EAVES) / 2)
        if y > 0:
            box("Collar", (-0.75, y - 0.05, 2.28), (0.75, y + 0.05, 2.4), look, 0.01)
    (top, bottom), (near, far) = SKYLIGHT
    middle, span = (top + bottom) / 2, bottom - top

    def bar(name, size, down, along):
        result = box(name, [-s / 2 for s in size], [s / 2 for s in size], look)
        result.rotation_euler = (0, -slope, 0)
        result.location = (-HALF_WIDTH * down / length, along, RIDGE + (EAVES - RIDGE) * down / length)

    bar("SkylightBar", (span + 0.1, 0.05, 0.05), middle, (near + far) / 2)
    for down in (top, middle, bottom):
        bar("SkylightBar", (0.05, far - near + 0.1, 0.05), down, (near + far) / 2)
    for along in (near, far):
        bar("SkylightBar", (span + 0.1, 0.06, 0.06), middle, along)


def floor(looks):
    """Add boards of varying brown."""
    chance = random.Random(4)
    x = -HALF_WIDTH
    while x < HALF_WIDTH:
        wide = chance.uniform(0.17, 0.24)
        low = (x + 0.004, -HALF_LENGTH, -0.05)
        box("Board", low, (x + wide, HALF_LENGTH, chance.uniform(-0.006, 0.0)), chance.choice(looks))
        x += wide
    box("Underside", (-HALF_WIDTH, -HALF_LENGTH, -0.09), (HALF_WIDTH, HALF_LENGTH, -0.04), looks[0])


def things(wood, dark, stone, green):
    """Add the monkey on its plinth, in the light, and crates beside it."""
    box("Plinth", (0.36, 0.24, 0.0), (0.84, 0.72, 0.52), stone, 0.02)
    box("PlinthTop", (0.32, 0.2, 0.52), (0.88, 0.76, 0.58), stone, 0.015)
    bpy.ops.mesh.primitive_monkey_add(size=0.62, location=(0.6, 0.47, 0.87), rotation=(-0.25, 0, -0.45))
    monkey = bpy.context.object
    monkey.name = monkey.data.name = "Suzanne"
    monkey.data.materials.append(green)
    modifier = monkey.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 1
    bpy.ops.object.shade_smooth()
    for name, size, place, turn in (
        ("CrateLarge", 0.7, (1.55, 1.75), 0.25),
        ("CrateSmall", 0.42, (0.85, 1.95), -0.3),
        ("CrateNear", 0.5, (-1.45, 1.5), 0.5),
    ):
        crate(name, size, place, turn, wood, dark)
    bpy.ops.mesh.primitive_cylinder_add(vertices=32, radius=0.24, depth=0.62, location=(-0.75, 2.1, 0.31))
    barrel = bpy.context.object
    barrel.name = barrel.data.name = "Barrel"
    barrel.data.materials.append(dark)
    bpy.ops.object.shade_auto_smooth()


def crate(name, size, place, turn, wood, dark):
    """Add a crate: a box with a frame of slats on each edge."""
    parent = bpy.data.objects.new(name, None)
    bpy.context.collection.objects.link(parent)
    parent.location, parent.rotation_euler = (*place, 0), (0, 0, turn)
    half, slat = size / 2, 0.06
    pieces = [box(name + "Body", (-half + 0.015, -half + 0.015, 0), (half - 0.015, half - 0.015, size - 0.02), wood)]
    for x in (-1, 1):
        for y in (-1, 1):
            low = [min(x * half, x * (half - slat)), min(y * half, y * (half - slat)), 0.0]
            pieces.append(box(name + "Post", low, (low[0] + slat, low[1] + slat, size), dark, 0.004))
    for z in (0.0, size - slat):
        for side in (-1, 1):
            a, b = sorted((side * half, side * (half - 0.03)))
            pieces.append(box(name + "Slat", (-half + slat, a, z), (half - slat, b, z + slat), dark, 0.004))
            pieces.append(box(name + "Slat", (a, -half + slat, z), (b, half - slat, z + slat), dark, 0.004))
    for piece in pieces:
        piece.parent = parent


def aim(thing, target):
    """Turn a camera or a light so that its −Z looks at a point."""
    thing.rotation_euler = (Vector(target) - thing.location).to_track_quat("-Z", "Y").to_euler()


def light_and_camera():
    """Add the spot outside the skylight, a dim evening sky, and the camera."""
    spot = bpy.data.lights.new("Spot", "SPOT")
    spot.energy, spot.color = 3000.0, (1.0, 0.84, 0.62)
    spot.spot_size, spot.spot_blend, spot.shadow_soft_size = math.radians(34), 0.2, 0.02
    lamp = bpy.data.objects.new("Spot", spot)
    lamp.location = (-1.85, -0.05, 4.15)
    bpy.context.collection.objects.link(lamp)
    aim(lamp, (0.42, 0.5, 0.6))
    world = bpy.data.worlds.new("Evening")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.3, 0.45, 1.0, 1.0)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.08
    bpy.context.scene.world = world
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 28.0
    eye = bpy.data.objects.new("Camera", camera)
    eye.location = (-0.35, -3.3, 1.25)
    bpy.context.collection.objects.link(eye)
    aim(eye, (-0.12, 0.6, 1.28))
    bpy.context.scene.camera = eye


def model():
    """Build the scene from nothing."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 1280, 720
    scene.frame_start = scene.frame_end = 1
    browns = [(0.20, 0.12, 0.07), (0.25, 0.155, 0.09), (0.17, 0.10, 0.06)]
    floor([material(f"Board{i}", color, 0.5) for i, color in enumerate(browns)])
    roof(material("Plaster", (0.33, 0.30, 0.27), 0.9))
    timber(material("Timber", (0.13, 0.085, 0.055), 0.75))
    things(
        material("CrateWood", (0.36, 0.24, 0.13)),
        material("DarkWood", (0.16, 0.09, 0.05), 0.6),
        material("Stone", (0.45, 0.43, 0.40), 0.85),
        material("Jade", (0.05, 0.32, 0.2), 0.3),
    )
    light_and_camera()


def export(path):
    """Export as text, without the names of Blender's own data."""
    bpy.ops.wm.usd_export(
        filepath=str(path),
        root_prim_path="/Attic",
        export_animation=False,
        export_uvmaps=False,
        export_materials=True,
        generate_preview_surface=True,
        generate_materialx_network=False,
        export_textures_mode="KEEP",
        export_custom_properties=False,
        author_blender_name=False,
        evaluation_mode="RENDER",
        export_subdivision="TESSELLATE",
        convert_world_material=True,
        relative_paths=True,
    )


if __name__ == "__main__":
    model()
    export(STAGE)
