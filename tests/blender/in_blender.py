"""Runs in Blender's Python: builds a scene, renders it with the engine, and prints what came of it as JSON.

    python -I in_blender.py CASE[,CASE...] FOLDER

The files of a case are written to FOLDER, or to FOLDER/CASE if there are several; a line "case CASE" is printed before
each, and the lines that it prints begin with "found ".
"""

import json
import math
import os
import signal
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "src" / "photonbeams" / "blender"))

import bpy  # noqa: E402
import extension  # noqa: E402
import numpy as np  # noqa: E402
from extension.process import POOL, Renderer  # noqa: E402
from mathutils import Vector  # noqa: E402

WIDTH, HEIGHT = 48, 27
TAKEN = []  # the renderers that were taken


def tell(**found):
    """Print what was found."""
    print("found " + json.dumps(found), flush=True)


def material(name, **inputs):
    """Return a Principled material with these inputs."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ").title().replace("Ior", "IOR")].default_value = value
    return made


def aim(thing, target):
    """Turn an object so that its −Z looks at a point."""
    thing.rotation_euler = (Vector(target) - thing.location).to_track_quat("-Z", "Y").to_euler()


def empty():
    """Return a scene with nothing in it, of small and quick pictures."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "PHOTONBEAMS"
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.photonbeams.passes, scene.photonbeams.beams, scene.photonbeams.denoise = 4, 1024, False
    scene.photonbeams.bounces = 0
    return scene


def room(fog=0.1):
    """Build a floor, two things of one mesh, a spot and a lamp in fog, and a camera."""
    scene = empty()
    bpy.ops.mesh.primitive_plane_add(size=12)
    bpy.context.object.data.materials.append(material("Floor", base_color=(0.6, 0.5, 0.4, 1), roughness=0.9))
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(0.6, 1, 0.4))
    box = bpy.context.object
    box.data.materials.append(material("Box", base_color=(0.1, 0.4, 0.6, 1)))
    twin = bpy.data.objects.new("Twin", box.data)
    twin.location, twin.rotation_euler = (-1.4, 1.5, 0.4), (0, 0, 0.5)
    scene.collection.objects.link(twin)
    for name, kind, place, power in (("Key", "SPOT", (-1, 0.5, 3), 200.0), ("Fill", "POINT", (2.5, 1.5, 2.0), 20.0)):
        light = bpy.data.lights.new(name, kind)
        light.energy, light.shadow_soft_size = power, 0.05
        lamp = bpy.data.objects.new(name, light)
        lamp.location = place
        scene.collection.objects.link(lamp)
        if kind == "SPOT":
            light.spot_size = math.radians(40)
            light.spot_blend = 0  # Blender's own export writes another softness for it
            aim(lamp, (0.2, 1.0, 0.0))
            lamp.lightgroup = "key"
    scene.view_layers[0].lightgroups.add(name="key")
    world = bpy.data.worlds.new("World")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.02, 0.03, 0.05, 1)
    if fog:
        volume = world.node_tree.nodes.new("ShaderNodeVolumeScatter")
        volume.inputs["Density"].default_value, volume.inputs["Color"].default_value = fog, (0.8, 0.8, 0.8, 1)
        world.node_tree.links.new(volume.outputs[0], world.node_tree.nodes["World Output"].inputs["Volume"])
    scene.world = world
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0.5, -5, 1.6)
    scene.collection.objects.link(camera)
    aim(camera, (0, 1, 0.9))
    scene.camera = camera
    scene.view_layers[0].use_pass_z = True
    return scene


def render(path, passes=True):
    """Render the frame into an EXR of float32, of all passes or of Combined alone."""
    settings = bpy.context.scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE" if passes else "IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if passes else "OPEN_EXR"
    settings.color_depth = "32"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def frame(folder):
    """Render a frame, and export the scene as Blender does."""
    scene = room()
    render(folder / "frame.exr")
    scene.world = None  # its volume hides its sky, as in Cycles; a stage's fog does not
    bpy.ops.wm.usd_export(filepath=str(folder / "frame.usdc"), evaluation_mode="RENDER")


def again(folder):
    """Render the same frame twice: the renderer stays warm, and the pictures are equal."""
    room()
    render(folder / "first.exr")
    begin = time.monotonic()
    render(folder / "second.exr")
    tell(same=len({each.number for each in TAKEN}) == 1, seconds=time.monotonic() - begin)


def layers(folder):
    """Render two view layers, of which one leaves out a lamp; the light group's name has a space."""
    scene = room()
    key = bpy.data.objects["Key"]
    key.lightgroup = "Key Light"
    second = scene.view_layers.new("Second")
    for each in scene.view_layers:
        each.lightgroups.add(name="Key Light")
    own = bpy.data.collections.new("Own")
    scene.collection.children.link(own)
    own.objects.link(key)
    scene.collection.objects.unlink(key)
    second.layer_collection.children["Own"].exclude = True
    render(folder / "layers.exr")


def aspect(folder):
    """Render pixels that are twice as wide as high, and square ones of the same view."""
    scene = room()
    render(folder / "square.exr", passes=False)
    scene.render.resolution_x, scene.render.pixel_aspect_x = WIDTH // 2, 2.0
    render(folder / "wide.exr", passes=False)  # Blender itself cannot write passes of such pixels


def reading(folder):
    """Read lights and materials of all kinds, and print their prims and what is told."""
    from extension.reading.kept import Kept
    from extension.reading.scene import SceneReader

    scene = room()
    for name, kind, values in (
        ("sun", "SUN", {"energy": 3.0, "angle": math.radians(1)}),
        ("bare_sun", "SUN", {"energy": 3.0, "angle": math.radians(1), "normalize": False}),
        ("ellipse", "AREA", {"energy": 10.0, "shape": "ELLIPSE", "size": 2.0, "size_y": 1.0}),
        ("bare_area", "AREA", {"energy": 10.0, "shape": "RECTANGLE", "size": 2.0, "size_y": 3.0, "normalize": False}),
        ("warm", "POINT", {"energy": 10.0, "use_temperature": True, "temperature": 3000.0, "exposure": 1.0}),
    ):
        light = bpy.data.lights.new(name, kind)
        for key, value in values.items():
            setattr(light, key, value)
        scene.collection.objects.link(bpy.data.objects.new(name, light))
    for output, smooth in (("Quadratic", 0.0), ("Quadratic", 0.5), ("Linear", 0.0), ("Wavelength", 0.0)):
        light = bpy.data.lights.new(f"{output} {smooth}", "POINT")
        light.use_nodes = True
        nodes = light.node_tree.nodes
        strength = nodes["Emission"].inputs["Strength"]
        if output == "Wavelength":
            strength.default_value, source = 7.0, nodes.new("ShaderNodeWavelength").outputs[0]
        else:
            falloff = nodes.new("ShaderNodeLightFalloff")
            falloff.inputs["Strength"].default_value, falloff.inputs["Smooth"].default_value = 50.0, smooth
            source = falloff.outputs[output]
        light.energy = math.pi
        light.node_tree.links.new(source, strength)
        scene.collection.objects.link(bpy.data.objects.new(light.name, light))
    image = bpy.data.images.new("Painted", 4, 4)
    made = material("Textured", transmission_weight=0.25, ior=1.3, sheen_weight=0.5)
    tree = made.node_tree
    texture, mapping, place = (tree.nodes.new(f"ShaderNode{each}") for each in ("TexImage", "Mapping", "TexCoord"))
    texture.image = image
    mapping.inputs["Scale"].default_value, mapping.inputs["Rotation"].default_value = (2, 3, 1), (0, 0, math.pi / 2)
    tree.links.new(place.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    bpy.data.objects["Twin"].data = bpy.data.objects["Cube"].data.copy()
    bpy.data.objects["Twin"].data.materials[0] = made
    foggy = bpy.data.materials.new("Foggy")
    inside = foggy.node_tree
    inside.nodes.remove(inside.nodes["Principled BSDF"])
    volume = inside.nodes.new("ShaderNodeVolumePrincipled")
    volume.inputs["Density"].default_value, volume.inputs["Color"].default_value = 2.0, (0.5, 0.25, 1.0, 1)
    inside.links.new(volume.outputs[0], inside.nodes["Material Output"].inputs["Volume"])
    bpy.data.objects["Cube"].data.materials[0] = foggy
    hollow = bpy.data.materials.new("Hollow")  # neither surface nor volume
    hollow.node_tree.nodes.clear()
    hollow.node_tree.nodes.new("ShaderNodeOutputMaterial")
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.name = "Two"
    bpy.context.object.data.materials.append(made)
    bpy.ops.mesh.primitive_cube_add()
    two = bpy.context.object
    two.name, two.visible_shadow = "Parts", False
    for each in (made, foggy, hollow):
        two.data.materials.append(each)
    for k, face in enumerate(two.data.polygons):
        face.material_index = k % 3
    said = []
    prims = SceneReader(bpy.context.evaluated_depsgraph_get(), Kept(str(folder)), said.append).prims()
    plain = {
        each["path"]: {**{name: value[1] for name, value in each.get("values", {}).items()
                          if not hasattr(value[1], "shape")}, "type": each["type"], "name": each.get("name")}
        for each in prims
    }  # fmt: skip
    tell(prims=plain, said=said, painted=(folder / "0_Painted.png").exists())


def part(folder):
    """Render the whole, and a border of it; then one that is drawn by hand."""
    scene = room()
    render(folder / "whole.exr")
    scene.render.use_border = scene.render.use_crop_to_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 1 / 3, 1.0
    render(folder / "part.exr")
    scene.render.border_min_x, scene.render.border_max_x = 0.123, 0.777
    scene.render.border_min_y, scene.render.border_max_y = 0.211, 0.903
    render(folder / "drawn.exr")


def stereo(folder):
    """Render two eyes."""
    scene = room()
    scene.render.use_multiview = True
    scene.camera.data.stereo.interocular_distance = 0.4
    render(folder / "stereo.exr")


def film(folder):
    """Render frames in which a lamp moves."""
    scene = room()
    lamp = bpy.data.objects["Key"]
    for number, x in ((1, -1.0), (2, 1.0)):
        lamp.location.x = x
        lamp.keyframe_insert("location", frame=number)
    scene.frame_start, scene.frame_end = 1, 2
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(folder / "film_")
    bpy.ops.render.render(animation=True)


def killed(folder):
    """Kill the renderer while it renders, and render again."""
    scene = room()
    render(folder / "before.exr")
    scene.photonbeams.passes = 100_000
    threading.Timer(1.0, lambda: os.kill(TAKEN[-1].number, signal.SIGKILL)).start()
    begin = time.monotonic()
    try:
        bpy.ops.render.render()
    except RuntimeError as error:
        tell(error=str(error))
    tell(seconds=time.monotonic() - begin)
    scene.photonbeams.passes = 4
    render(folder / "after.exr")


def matt():
    """Make the floor and the boxes reflect as a Diffuse BSDF, whose light is the same here and in Cycles."""
    for name in ("Floor", "Box"):
        tree = bpy.data.materials[name].node_tree
        shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = tree.nodes["Principled BSDF"].inputs["Base Color"].default_value
        tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


# The light of a luminaire that is another one on each side.
PROFILE = """IESNA:LM-63-1995
TILT=NONE
1 1000 0.04 7 5 1 2 0 0 0
1 1 100
0 15 30 45 60 75 90
0 90 180 270 360
500 480 400 300 160 60 0
500 450 300 120 30 0 0
500 420 200 40 0 0 0
500 490 450 380 260 120 10
500 480 400 300 160 60 0
"""


def give_profile(light, **values):
    """Give a lamp an IES Texture, half of whose product with a strength of two counts."""
    light.use_nodes = True
    tree = light.node_tree
    texture, half = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexIES", "Math"))
    texture.mode = "INTERNAL" if "ies" in values else "EXTERNAL"
    for key, value in values.items():
        setattr(texture, key, value)
    half.operation = "MULTIPLY"
    texture.inputs["Strength"].default_value, half.inputs[1].default_value = 2.0, 0.5
    tree.links.new(texture.outputs[0], half.inputs[0])
    tree.links.new(half.outputs[0], tree.nodes["Emission"].inputs["Strength"])


def lamps(folder):
    """Render a matt floor under one lamp of each kind, without fog, by this engine and by Cycles."""
    scene = room(fog=0)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.photonbeams.passes = 16
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 256, False, 0
    for name in ("Cube", "Twin", "Key", "Fill"):
        bpy.data.objects.remove(bpy.data.objects[name])
    scene.camera.location = (0, 0, 9)
    aim(scene.camera, (0, 0, 0))
    matt()
    kinds = {
        "point": ("POINT", {"shadow_soft_size": 0.3}), "tiny": ("POINT", {"shadow_soft_size": 0}),
        **{f"spot {blend}": ("SPOT", {"spot_size": size, "spot_blend": blend, "shadow_soft_size": 0.02})
           for size, blend in ((0.9, 0.0), (1.0, 0.15), (1.1, 0.5), (1.2, 1.0))},
        "area": ("AREA", {"shape": "RECTANGLE", "size": 1.0, "size_y": 0.5}),
        "disc": ("AREA", {"shape": "DISK", "size": 1.0}), "sun": ("SUN", {"angle": 0.1}),
        "spread": ("AREA", {"shape": "RECTANGLE", "size": 1.0, "size_y": 0.5, "spread": 1.0}),
        "narrow": ("AREA", {"shape": "DISK", "size": 1.0, "spread": 0.3}),
        **{f"profile {kind}": (kind, {"ies": mode}) for kind, mode in
           (("POINT", "INTERNAL"), ("SPOT", "EXTERNAL"), ("AREA", "INTERNAL"), ("SUN", "INTERNAL"))},
        "profile that is missing": ("POINT", {"ies": "EXTERNAL", "shadow_soft_size": 0.0}),
    }  # fmt: skip
    profile = bpy.data.texts.new("Profile")
    profile.write(PROFILE)
    (folder / "spot.ies").write_text(PROFILE)
    for name, (kind, values) in kinds.items():
        light = bpy.data.lights.new(name, kind)
        light.energy = 3.0 if kind == "SUN" else 500.0
        lamp = bpy.data.objects.new(name, light)
        if mode := values.pop("ies", None):
            file = "" if "missing" in name else str(folder / "spot.ies")
            give_profile(light, **({"ies": profile} if mode == "INTERNAL" else {"filepath": file}))
            lamp.rotation_euler = (0.3, 0.2, 0.7)
        for key, value in values.items():
            setattr(light, key, value)
        lamp.location = (0.3, 0.2, 3)
        scene.collection.objects.link(lamp)
        for engine in ("PHOTONBEAMS", "CYCLES"):
            scene.render.engine = engine
            render(folder / f"{name}.{engine}.exr", passes=False)
        bpy.data.objects.remove(lamp)


def over(folder):
    """Set up beams over Cycles, and render both and their composite."""
    scene = room()
    scene.photonbeams.passes, scene.photonbeams.beams = 16, 4096
    matt()
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    render(folder / "whole.exr")
    bpy.ops.photonbeams.over_cycles()
    beams = bpy.data.scenes["Scene Beams"]
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 256, False, 0
    render(folder / "composite.exr", passes=False)
    scene.compositing_node_group = None
    render(folder / "plate.exr", passes=False)
    bpy.context.window.scene = beams
    render(folder / "beams.exr")
    tell(engines=[scene.render.engine, beams.render.engine], worlds=[scene.world.name, beams.world.name])


def wrong(folder):
    """Render what has no camera, what the renderer refuses, and without a renderer."""
    scene = room()
    camera, scene.camera = scene.camera, None
    for case in ("no camera", "a lamp", "no light", "no renderer"):
        if case == "a lamp":  # Blender takes any object for a camera
            scene.camera = bpy.data.objects["Key"]
            scene.camera.name = "Key\x1b["
        if case == "no light":
            scene.camera = camera
            bpy.data.lights.remove(bpy.data.lights["Key"])
            bpy.data.lights.remove(bpy.data.lights["Fill"])
            scene.world = None
        if case == "no renderer":
            POOL.close()
            os.environ["PHOTONBEAMS_PYTHON"] = "/nowhere/python"
        try:
            bpy.ops.render.render()
        except RuntimeError as error:
            tell(case=case, error=str(error))


class Screen:
    """A viewport that looks through the scene's camera, as the engine has it drawn."""

    def __init__(self):
        from extension.viewport import Viewport

        self.viewport = Viewport()
        bpy.app.handlers.depsgraph_update_post.append(self.update)

    def update(self, _scene, depsgraph):
        self.viewport.change(depsgraph.updates)

    def show(self, width=WIDTH, height=HEIGHT, passes=2):
        """Show the scene as it is now; return the finished picture, and the sizes of all pictures."""
        from extension.reading.cameras import viewport_area, viewport_prim

        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        camera = bpy.context.scene.camera.evaluated_get(depsgraph)
        region = SimpleNamespace(
            view_matrix=camera.matrix_world.inverted(), view_perspective="CAMERA",
            window_matrix=camera.calc_matrix_camera(depsgraph, x=width, y=height),
        )  # fmt: skip
        space = SimpleNamespace(lens=50, clip_start=0.1, clip_end=100, camera=bpy.context.scene.camera)
        area = viewport_area(region, space, bpy.context.scene)
        view = {"width": width, "height": height, "area": area, "passes": passes, "denoise": False, "bounces": 0}
        self.viewport.picture, sizes, until = None, [], time.monotonic() + 100
        self.viewport.show(depsgraph, "", viewport_prim(region, space, depsgraph), view)
        while time.monotonic() < until:
            # A renderer that has ended may be found so when the scene is sent, and nothing comes from it then.
            if self.viewport.poll() or self.viewport._renderer is None:
                if self.viewport.picture is not None:
                    sizes.append(self.viewport.picture.shape[1])
                whole = sizes and sizes[-1] == width and self.viewport.text.startswith(f"Pass {passes} of")
                if whole or self.viewport.picture is None:
                    break
            time.sleep(0.002)
        return self.viewport.picture, sizes

    def close(self):
        bpy.app.handlers.depsgraph_update_post.remove(self.update)
        self.viewport.close()


def few_beams():
    """Give each lamp a number of beams: a viewport would choose many."""
    for light in bpy.data.lights:
        light.photonbeams.count = 256


def viewport(folder):
    """Show a viewport, edit what it shows, and compare with viewports that see it for the first time."""
    scene, sent = room(), []
    few_beams()
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    write = Renderer.send

    def send(self, do, **content):
        sent.append([each["path"] for each in content.get("prims", ())] if do == "scene" else do)
        write(self, do, **content)

    Renderer.send = send
    screen = Screen()
    first, sizes = screen.show(320, 180)
    np.save(folder / "first.npy", first)
    tell(sizes=sizes, sent=sent[:], text=screen.viewport.text)

    def edit(name, change):
        sent.clear()
        change()
        picture, _ = screen.show()
        told = sent[:]
        fresh = Screen()
        expected, _ = fresh.show()
        fresh.close()
        tell(edit=name, sent=told, same=bool(np.array_equal(picture, expected)), mean=float(picture[..., :3].mean()))

    def brighter():
        for name in ("Key", "Fill"):
            bpy.data.lights[name].energy *= 2

    def sculpt():
        bpy.data.objects["Cube"].data.vertices[0].co.x -= 1
        bpy.data.objects["Cube"].data.update()

    edit("size", lambda: None)
    edit("light", brighter)
    edit("camera", lambda: setattr(scene.camera.location, "x", 0.7))
    edit("lens", lambda: setattr(scene.camera.data, "lens", 40))
    edit("object", lambda: setattr(bpy.data.objects["Twin"].location, "x", -1.0))
    edit("mesh", sculpt)
    edit("material", lambda: setattr(floor_color(), "default_value", (0.1, 0.2, 0.3, 1)))
    whole = screen.viewport.picture
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 0.0, 0.5
    edit("border", lambda: None)
    inside, rows, columns = screen.viewport.picture, slice(HEIGHT // 2, HEIGHT), slice(WIDTH // 4, 3 * WIDTH // 4)
    same = bool(np.array_equal(inside[rows, columns], whole[rows, columns]))
    tell(border=same, rest=float(inside[: HEIGHT // 2].max()))
    scene.render.use_border = False
    edit("deleted", lambda: bpy.data.objects.remove(bpy.data.objects["Twin"]))
    os.kill(screen.viewport._renderer.number, signal.SIGKILL)
    screen.viewport._renderer._process.wait()
    scene.camera.location.x = 0.9
    nothing, _ = screen.show()
    told = screen.viewport.text
    picture, _ = screen.show()
    tell(killed=told, nothing=nothing is None, again=picture is not None)
    screen.close()


def floor_color():
    """Return the input of the floor's colour."""
    return bpy.data.materials["Floor"].node_tree.nodes["Principled BSDF"].inputs["Base Color"]


def memory(number):
    """Return the memory of a process in MB."""
    return int(Path(f"/proc/{number}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def leaks(folder):
    """Edit, resize and load again and again, and print the memory of both processes."""
    room()
    few_beams()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"))
    screen = Screen()

    def used(what, count, change):
        found = []
        for k in range(count):
            change(k)
            if k % (count // 5) == count // 5 - 1:
                found.append([memory(os.getpid()), memory(screen.viewport._renderer.number)])
        tell(what=what, used=found)

    def edit(k):
        bpy.data.lights["Key"].energy = 100 + k
        bpy.data.objects["Cube"].data.vertices[0].co.x += 0.01 * (-1) ** k
        bpy.data.objects["Cube"].data.update()
        screen.show(passes=1)

    def resize(k):
        screen.show(WIDTH + k % 20, HEIGHT + k % 7, passes=1)

    def load(k):
        nonlocal screen
        screen.close()
        bpy.ops.wm.open_mainfile(filepath=str(folder / "room.blend"))
        screen = Screen()
        screen.show(passes=1)

    used("edits", 20, edit)
    used("sizes", 20, resize)
    used("loads", 20, load)
    screen.close()
    tell(processes=len({each.number for each in TAKEN}))


def registered(folder):
    """Register and unregister, and look for traces."""

    def traces():
        return [each for each in dir(bpy.types) if each.lower().startswith("photonbeams")]

    shared = [each for each in bpy.types.Panel.__subclasses__() if "PHOTONBEAMS" in getattr(each, "COMPAT_ENGINES", ())]
    extension.unregister()
    left = [
        each
        for each in bpy.types.Panel.__subclasses__()
        if "PHOTONBEAMS" in getattr(each, "COMPAT_ENGINES", ()) and "extension." not in str(each)
    ]
    owners = [bpy.types.Scene, bpy.types.Light, bpy.types.World, bpy.types.Curve, bpy.types.NodeTree]
    own = any(hasattr(each, "photonbeams") for each in owners)
    own |= any("extension." in each.__module__ for each in bpy.types.VIEW3D_MT_add._dyn_ui_initialize())
    tell(shared=len(shared), left=len(left), scene=own, traces=traces())
    extension.register()


def run(*cases):
    """Run the cases that the command line names."""
    extension.register()
    take = POOL.take
    POOL.take = lambda chosen: TAKEN.append(take(chosen)) or TAKEN[-1]
    by_name = {each.__name__: each for each in cases}
    names, folder = sys.argv[1].split(","), Path(sys.argv[2])
    for name in names:
        place = folder / name if len(names) > 1 else folder
        place.mkdir(exist_ok=True)
        TAKEN.clear()
        print(f"\ncase {name}", flush=True)
        by_name[name](place)
    extension.unregister()


if __name__ == "__main__":
    run(
        frame,
        again,
        layers,
        aspect,
        reading,
        part,
        stereo,
        film,
        killed,
        viewport,
        leaks,
        lamps,
        over,
        wrong,
        registered,
    )
