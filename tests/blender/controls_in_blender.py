"""Runs in Blender's Python: what an artist sets for beams, as `in_blender.py` does.

python -I controls_in_blender.py CASE FOLDER
"""

import sys
from functools import partial
from inspect import isfunction
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bpy
import numpy as np
from in_blender import aim, empty, render, room, run, tell

# Blender itself finds its OpenUSD; as a module, it is in a folder of its own.
sys.path.append(str(next(Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/*/site-packages"))))


def painted(left, right):
    """Return an image whose halves have these linear colours."""
    image = bpy.data.images.new("Slide", 8, 8, float_buffer=True)
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[:, :4, :3], pixels[:, 4:, :3] = left, right
    image.pixels.foreach_set(pixels.ravel())
    return image


def shown():
    """Return the room with a lamp that has a look, one that makes no beams, a portal, and curves that are beams."""
    from extension.looks import PRESETS, apply_preset, new_look

    scene = room()
    scene.photonbeams.passes = 8
    key, fill = (bpy.data.lights[name].photonbeams for name in ("Key", "Fill"))
    key.intensity, fill.enabled = 2.0, False
    key.look = look = new_look("Ember")
    apply_preset(look, next(each for each in PRESETS if each["label"] == "Ember"))
    look.photonbeams.across_profile = "tabulated"
    key.gobo = painted((1.0, 0.6, 0.4), (0.1, 0.2, 0.5))
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 2.0, 0.0
    lamp = bpy.data.objects.new("Sun", sun)
    lamp.location = (4, 1, 3)
    aim(lamp, (1.5, 1, 1))
    scene.collection.objects.link(lamp)
    bpy.ops.mesh.primitive_plane_add(size=0.6, location=(1.8, 1.2, 1.4))
    sun.photonbeams.portal = bpy.context.object
    line = bpy.data.curves.new("Line", "CURVE")
    line.dimensions = "3D"
    spline = line.splines.new("BEZIER")
    spline.bezier_points.add(1)
    for point, x in zip(spline.bezier_points, (-1.0, 1.0), strict=True):
        point.co, point.handle_left, point.handle_right = (x, 0, 2), (x - 0.3, 0, 2.2), (x + 0.3, 0, 1.8)
    straight = line.splines.new("POLY")
    straight.points.add(1)
    straight.points[0].co, straight.points[1].co = (-1, 1, 0.2, 1), (1, 1, 1.8, 1)
    line.bevel_depth = 0.1  # it is not a tube, nevertheless
    line.photonbeams.enabled, line.photonbeams.power, line.photonbeams.color = True, 2.0, (0.2, 0.5, 1.0)
    scene.collection.objects.link(bpy.data.objects.new("Line", line))
    return scene


def controls(folder):
    """Render a frame; export the scene with the hook, and without."""
    from extension.export import PhotonBeamsExport

    shown()
    render(folder / "frame.exr")
    bpy.ops.wm.usd_export(filepath=str(folder / "hooked.usdc"), evaluation_mode="RENDER")
    bpy.utils.unregister_class(PhotonBeamsExport)
    bpy.ops.wm.usd_export(filepath=str(folder / "plain.usda"), evaluation_mode="RENDER")
    bpy.utils.register_class(PhotonBeamsExport)


def read(folder):
    """Return the prims of the scene by path, with arrays as lists, and what is told."""
    from extension.reading.kept import Kept
    from extension.reading.scene import SceneReader

    for each in (*bpy.data.lights, *bpy.data.curves, *bpy.data.node_groups, *bpy.data.worlds):
        each.update_tag()  # as Blender's own user interface does
    said = []
    prims = SceneReader(bpy.context.evaluated_depsgraph_get(), Kept(str(folder)), said.append).prims()
    plain = {}
    for each in prims:
        values = {name: np.asarray(value).tolist() for name, (_, value, *_) in each.get("values", {}).items()}
        plain[each["path"]] = {"type": each["type"], "targets": each.get("targets", {}), **values}
    return plain, said


def values(folder):
    """Read lamps, portals of Cycles, the world, curves of all kinds, and text."""
    scene = shown()
    sky = bpy.data.lights.new("Window", "AREA")
    sky.cycles.is_portal, sky.shape, sky.size, sky.size_y = True, "RECTANGLE", 2.0, 1.0
    scene.collection.objects.link(bpy.data.objects.new("Window", sky))
    world = scene.world.photonbeams
    world.enabled, world.count = True, 512
    world.fog_falloff, world.fog_ground, world.fog_noise, world.fog_noise_drift = 1.5, 0.25, 0.5, (0.5, 0, 0)
    slide = bpy.data.lights["Fill"]
    slide.use_nodes = True
    tree = slide.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images["Slide"]
    tree.links.new(texture.outputs["Color"], tree.nodes["Emission"].inputs["Color"])
    slide.photonbeams.gobo_angle, slide.photonbeams.gobo_wrap = np.pi / 3, "repeat"
    bpy.ops.curve.primitive_nurbs_circle_add()
    circle = bpy.context.object
    circle.name, circle.data.photonbeams.enabled, circle.lightgroup = "Ring", True, "key"
    circle.data.splines[0].use_cyclic_u = True
    circle.data.photonbeams.look = bpy.data.node_groups["Ember"]
    bpy.ops.curve.primitive_nurbs_path_add()
    bpy.context.object.data.splines[0].order_u, bpy.context.object.data.bevel_depth = 3, 0.1
    bpy.context.object.name, bpy.context.object.data.photonbeams.enabled = "Third", True
    path = bpy.data.curves.new("Path", "CURVE")
    path.dimensions, path.photonbeams.enabled = "3D", True
    spline = path.splines.new("NURBS")
    spline.points.add(4)
    spline.order_u = 4
    for k, point in enumerate(spline.points):
        point.co, point.radius = (k, k % 2, 0, 1), 1 + k
    scene.collection.objects.link(bpy.data.objects.new("Path", path))
    bpy.ops.object.text_add()
    bpy.context.object.name, bpy.context.object.data.extrude = "Title", 0.1
    plane = bpy.data.objects["Plane.001"]
    plane.hide_render = True
    first, said = read(folder)
    key = bpy.data.lights["Key"].photonbeams
    key.look.nodes.remove(key.look.nodes["across curve"])
    key.portal = bpy.data.objects.new("Empty", None)
    bpy.data.objects["Third"].data.splines.clear()
    key.look.photonbeams.along_use_curve = True
    second, later = read(folder)
    tell(prims=first, said=said, changed=second, later=later)


def presets(_folder):
    """Give each preset to a look and read it."""
    from extension.looks import PRESETS, apply_preset, new_look
    from extension.reading.looks import look_prim

    tree = new_look("Look")
    for each in PRESETS:
        apply_preset(tree, next(own for own in PRESETS if own["label"] == "Physical" and own["factor"] == "look"))
        apply_preset(tree, each)
        prim = look_prim(tree, "/Look", None, print)
        found = {name: np.asarray(value).tolist() for name, value in prim.values.items()}
        tell(name=each["name"], values=found)


class Layout:
    """What a panel draws on: it notes what is shown, and all that is inside of it is itself."""

    def __init__(self):
        self.shown = []

    def prop(self, data, name, **_):
        own = data.bl_rna.properties[name]
        self.shown.append([f"{data.bl_rna.identifier}.{name}", own.name, own.description])

    def prop_search(self, data, name, *_, **__):
        self.prop(data, name)

    def template_ID(self, data, name, new="", open="", **_):  # noqa: N802 - Blender's names
        self.prop(data, name)
        for each in filter(None, (new, open)):
            self.operator(each)

    def template_color_ramp(self, data, name, **_):
        self.shown.append([type(data).__name__, name, type(getattr(data, name)).__name__])

    template_curve_mapping = template_color_ramp

    def menu(self, name, **_):
        self.shown.append([name, getattr(bpy.types, name).bl_label, name])

    popover = menu

    def template_icon(self, icon, scale):  # without a window, there are no icons
        self.shown.append(["icon", str(icon), str(scale)])

    def operator(self, name, **_):
        module, _, function = name.partition(".")
        own = getattr(getattr(bpy.ops, module), function).get_rna_type()
        self.shown.append([name, own.name, own.description])
        return SimpleNamespace()

    def inside(self, *_, **__):
        return self

    row = column = grid_flow = inside


class Stand:
    """Stands in for a panel, which Blender alone can make."""

    def __init__(self, panel, layout):
        self.panel, self.layout = panel, layout

    def __getattr__(self, name):
        own = getattr(self.panel, name)
        return partial(own, self) if isfunction(own) else own


def panels(_folder):
    """Draw all panels and menus for a lamp of each kind, the world, a curve and the scene."""
    from extension import adding, light_panels
    from extension import panels as others
    from extension.looks import PRESETS, apply_preset

    scene = shown()
    bpy.data.lights["Sun"].photonbeams.gobo = bpy.data.images["Slide"]
    owners = [*bpy.data.lights, *bpy.data.curves, bpy.data.worlds["World"]]
    shown_by = {}
    for owner in owners:
        own = owner.photonbeams
        own.look = bpy.data.node_groups["Ember"]
        for preset in (None, *PRESETS):
            if preset is not None:
                apply_preset(own.look, preset)
            own.look.photonbeams.along_use_curve = True
            kind = type(owner).__name__.lower()
            member = "light" if "light" in kind else "curve" if "curve" in kind else "world"
            thing = next((each for each in bpy.data.objects if each.data == owner), None)
            context = SimpleNamespace(
                engine="PHOTONBEAMS", object=thing, scene=scene, view_layer=scene.view_layers[0], **{member: owner}
            )
            for each in (*light_panels.CLASSES, *others.CLASSES, adding.PHOTONBEAMS_MT_add):
                if each is others.PHOTONBEAMS_PT_light_groups or (hasattr(each, "poll") and not each.poll(context)):
                    continue
                layout = Layout()
                each.draw(Stand(each, layout), context)
                if hasattr(each, "draw_header"):
                    each.draw_header(Stand(each, layout), context)
                shown_by.setdefault(each.__name__, []).extend(layout.shown)
    other = SimpleNamespace(engine="CYCLES", object=None, light=bpy.data.lights[0])
    tell(shown=shown_by, elsewhere=[each.__name__ for each in light_panels.CLASSES
                                    if hasattr(each, "poll") and each.poll(other)])  # fmt: skip


def added(folder):
    """Add the ready-made things to an empty scene, each at the cursor, and render them."""
    for name in ("keyhole", "blinds", "strands"):
        scene = empty()
        scene.cursor.location = (1.0, 2.0, 3.0)
        getattr(bpy.ops.photonbeams, f"add_{name}")()
        thing = bpy.context.object
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        camera.location = (-2.5, -2.5, 3.4) if name != "strands" else (1, -3, 4)
        scene.collection.objects.link(camera)
        aim(camera, (0.9, 1.2, 2.6) if name != "strands" else (1, 2, 4))
        scene.camera = camera
        if "--large" in sys.argv:
            scene.render.resolution_x, scene.render.resolution_y = 320, 180
            scene.photonbeams.denoise, scene.photonbeams.beams, scene.photonbeams.passes = True, 0, 16
        render(folder / f"{name}.exr")
        area = sum(each.area for each in thing.data.polygons) if thing.type == "MESH" else 0.0
        prims, said = read(folder)
        tell(
            name=name, place=list(thing.location), area=area, prims=sorted(prims), said=said, world=len(bpy.data.worlds)
        )
        getattr(bpy.ops.photonbeams, f"add_{name}")()
        tell(volumes=sum(each.type == "VOLUME_SCATTER" for each in scene.world.node_tree.nodes))


def exported(folder):
    """Export what Blender itself leaves out: fog in a mesh, nodes of lamps, portals with things below them."""
    scene = shown()
    bpy.data.objects["Key"].lightgroup = "Key Light"
    key, fill = (bpy.data.lights[name] for name in ("Key", "Fill"))
    key.use_temperature, key.temperature, key.color = True, 3000.0, (0.5, 1.0, 1.0)
    tell(temperature=list(key.temperature_color))
    fill.use_nodes, fill.color = True, (1.0, 0.5, 1.0)
    fill.node_tree.nodes["Emission"].inputs["Strength"].default_value = 3.0
    fill.node_tree.nodes["Emission"].inputs["Color"].default_value = (0.5, 1.0, 1.0, 1.0)
    sky = bpy.data.lights.new("Window", "AREA")
    sky.cycles.is_portal = True
    window = bpy.data.objects.new("Window", sky)
    scene.collection.objects.link(window)
    twin = bpy.data.objects["Twin"]
    twin.parent = window  # it stays, though the portal is no lamp
    twin.visible_camera, twin.visible_shadow, twin.is_holdout = False, False, True
    scene.world.photonbeams.enabled = True
    bpy.ops.mesh.primitive_cube_add(location=(-3, 3, 1))
    made = bpy.data.materials.new("Foggy")
    made.node_tree.nodes.remove(made.node_tree.nodes["Principled BSDF"])
    volume = made.node_tree.nodes.new("ShaderNodeVolumeScatter")
    volume.inputs["Density"].default_value, volume.inputs["Color"].default_value = 0.5, (0.2, 0.4, 0.6, 1.0)
    made.node_tree.links.new(volume.outputs[0], made.node_tree.nodes["Material Output"].inputs["Volume"])
    bpy.context.object.name = "Box"
    bpy.context.object.data.materials.append(made)
    boxes = bpy.data.collections.new("Boxes")
    copy = bpy.data.objects.new("Copy", None)
    copy.instance_type, copy.instance_collection = "COLLECTION", boxes
    scene.collection.objects.link(copy)
    boxes.objects.link(bpy.data.objects["Cube"])
    lit = bpy.data.collections.new("Lit")
    for each in (bpy.data.objects["Box"], copy):
        lit.objects.link(each)
    bpy.data.objects["Key"].light_linking.receiver_collection = lit
    panel = bpy.data.lights.new("Panel", "AREA")
    panel.use_shadow, panel.spread = False, np.pi / 2
    scene.collection.objects.link(bpy.data.objects.new("Panel", panel))
    bpy.ops.wm.usd_export(filepath=str(folder / "exported.usda"), evaluation_mode="RENDER")
    scene.render.engine = "CYCLES"
    bpy.ops.wm.usd_export(filepath=str(folder / "of_cycles.usda"), evaluation_mode="RENDER")


def saved(folder):
    """Give lamps presets by the buttons, save the file and open it again."""
    shown()
    for name, preset in (("Key", "across-double"), ("Fill", "look-laser"), ("Line", "look-deep-water")):
        bpy.context.view_layer.objects.active = bpy.data.objects[name]
        bpy.ops.photonbeams.look_preset(preset=preset)
    bpy.context.view_layer.objects.active = bpy.data.objects["Sun"]
    bpy.ops.photonbeams.look_new()
    before, _ = read(folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "saved.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(folder / "saved.blend"))
    after, said = read(folder)
    bpy.ops.wm.set_working_color_space(working_space="ACEScg")
    tell(before=before, after=after, said=said, in_acescg=read(folder)[1])


if __name__ == "__main__":
    run(controls, values, presets, panels, added, exported, saved)
