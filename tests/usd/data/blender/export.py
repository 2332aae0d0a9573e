"""Write blender.usda with Blender's own exporter: `python export.py`, with bpy 5.0.1 installed.

Every light stands alone at a place of its own, so that the test can tell them apart by name and by place.
"""

import math
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def placed(data, location=(0, 0, 0), rotation=(0, 0, 0)):
    thing = bpy.data.objects.new(data.name, data)
    thing.location, thing.rotation_euler = location, rotation
    scene.collection.objects.link(thing)
    return thing


def lamp(name, kind, location, rotation=(0, 0, 0), **settings):
    data = bpy.data.lights.new(name, kind)
    for key, value in settings.items():
        setattr(data, key, value)
    return placed(data, location, rotation)


def picture(name, pixels):
    image = bpy.data.images.new(name, pixels.shape[1], pixels.shape[0])
    image.pixels = np.dstack([pixels, np.ones(pixels.shape[:2])]).astype(np.float32).ravel()
    image.filepath_raw, image.file_format = str(HERE / f"{name}.png"), "PNG"
    image.save()
    return image


lamp("spot", "SPOT", (1, 2, 3), (0.5, 0, 0), energy=100, spot_size=math.radians(40), spot_blend=0.3, shadow_soft_size=0)
lamp("soft_spot", "SPOT", (2, 2, 3), energy=100, spot_size=math.radians(40), shadow_soft_size=0.1)
lamp("point", "POINT", (3, 2, 3), energy=50, shadow_soft_size=0.2, color=(1, 0.5, 0.25), exposure=1)
lamp("rect", "AREA", (4, 2, 3), energy=10, shape="RECTANGLE", size=2, size_y=1).scale = (2, 2, 2)
lamp("disk", "AREA", (5, 2, 3), energy=10, shape="DISK", size=2)
lamp("sun", "SUN", (6, 2, 3), (math.pi / 2, 0, 0), energy=3, angle=math.radians(1))
lamp("sharp_sun", "SUN", (7, 2, 3), energy=3, angle=0)

camera = bpy.data.cameras.new("camera")
camera.lens, camera.shift_x, camera.shift_y = 35, 0.1, -0.05
scene.camera = placed(camera, (0, -10, 2), (math.pi / 2, 0, 0))

world = bpy.data.worlds.new("world")
scene.world = world
sky = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
sky.image = picture("sky", np.full((2, 4, 3), 0.5))
world.node_tree.links.new(sky.outputs["Color"], world.node_tree.nodes["Background"].inputs["Color"])

bpy.ops.mesh.primitive_cube_add()
cube = bpy.context.object
material = bpy.data.materials.new("checks")
cube.data.materials.append(material)
texture = material.node_tree.nodes.new("ShaderNodeTexImage")
checks = np.zeros((4, 2, 3))
checks[:2, :, 0] = 1.0  # Blender counts rows from below: red is the lower half, v < 0.5
checks[2:, :, 1] = 1.0
texture.image = picture("checks", checks)
shader = material.node_tree.nodes["Principled BSDF"]
material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])

parts = bpy.data.collections.new("parts")
bpy.ops.mesh.primitive_uv_sphere_add(segments=8, ring_count=4)
ball = bpy.context.object
ball.name = ball.data.name = "ball"
bpy.ops.object.shade_smooth()
scene.collection.objects.unlink(ball)
parts.objects.link(ball)
for index in range(2):
    empty = bpy.data.objects.new(f"copy{index}", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", parts
    empty.location, empty.rotation_euler = (3 + 3 * index, 0, 0), (0, 0, index)
    scene.collection.objects.link(empty)

bpy.ops.wm.usd_export(filepath=str(HERE / "blender.usda"), use_instancing=True, relative_paths=True)
for copied in HERE.glob("*.png"):
    copied.unlink()  # the exporter keeps its own copies in textures/
