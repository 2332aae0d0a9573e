"""Kernels do not depend on how many: another seed and another size of a picture run those of the first.

The numbers of light paths that go on, of tiles and of pixels differ between seeds and sizes. Where a kernel contains
one of these numbers, or where a plug-in has its place in a table of virtual calls, each picture compiles it again. What
a pilot decides, and what happens to few paths, may differ as well, and has kernels of its own, once.
"""

import gc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.runtime.device import mitsuba
from tests.helpers.comparison import quad
from tests.helpers.kernels import compiled, without_constants
from tests.helpers.mitsuba_scenes import camera, cloud, cube_of, load, rgb
from tests.helpers.sweep import sweep

mi = mitsuba()

EXAMPLES = Path(__file__).parents[2] / "examples"
# Not the smoke, which moves: the worlds at the shutter's opening and closing have places of their own in tables of
# virtual calls, and a late step of a light path may be in one of them alone.
SHOTS = ("keyhole/keyhole", "concert/concert", "forest/forest", "magic/magic", "shaft/physical")
# Not the slits: at 32 pixels, one more plug-in has a place in the tables.
SCENES = ("cloud", "cornell_fog", "flask", "glass_ball", "mirrors")
#: Seeds and widths, in pixels, of the first picture and of others.
FIRST = (0, 48)
OTHERS = ((1, 48), (0, 64), (0, 32))
#: Scenes with at least one of each kind: cut-outs, coloured smoke, glass, mirrors, deep pictures, a lens.
KINDS: dict[str, Callable[[], Callable[..., object]]] = {}

Picture = Callable[..., object]  # of a seed and a width


def kind(make: Callable[[], Picture]) -> Callable[[], Picture]:
    """Add a kind, named after the function that makes its picture."""
    KINDS[make.__name__.replace("_", " ")] = make
    return make


def of_shot(shot: pb.Shot, **settings: object) -> Picture:
    return lambda seed, width: shot.render(1, 2, seed=seed, width=width, **settings)


def of_plugin(plugin: object, **settings: object) -> Picture:
    """Return a function that renders a Mitsuba scene through `mi.render`."""
    parameters = mi.traverse(plugin)
    name = next(name for name in parameters.keys() if name.endswith("film.size"))  # noqa: SIM118
    integrator = mi.load_dict({"type": "photon_beams", "paths": 1024, **settings})

    def picture(seed: int, width: int) -> object:
        height = width * 9 // 16
        parameters[name] = [width, height]
        parameters.update()
        dr.eval()  # what Mitsuba itself computes of the film's size
        dr.kernel_history_clear()
        return mi.render(plugin, integrator=integrator, spp=2, seed=seed)

    return picture


def described(*meshes: scene.Mesh, lens: float = 0.0) -> pb.Shot:
    """Return a shot of meshes on a floor, under a small lamp, in thin fog."""
    lamp = scene.SphereLight("/Lamp", (60.0,) * 3, center=np.array([0.5, 2.5, 0.5]), radius=0.1)
    floor = quad("/Floor", [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], scene.Material(diffuse=(0.7,) * 3))
    content = scene.Scene(lights=(lamp,), meshes=(floor, *meshes), media=(scene.Medium(scattering=0.05),))
    eye = scene.Camera.look_at((0, 0.8, 4), (0, 0.6, 0), fov=50)
    return pb.Shot(content, replace(eye, lens_radius=lens, focus_distance=4.0))


def card(name: str, x: float = 0.0, **material: object) -> scene.Mesh:
    corners = np.array([[-0.6, 0.2, 0.5], [0.6, 0.2, 0.5], [0.6, 1.2, -0.2], [-0.6, 1.2, -0.2]])
    return quad(name, corners + np.array([x, 0, 0]), scene.Material(**material))


@kind
def cutouts() -> Picture:
    return of_shot(described(card("/Leaf", diffuse=(0.6, 0.7, 0.2), opacity=0.4, presence=True)), max_depth=3)


@kind
def glass_and_a_mirror() -> Picture:
    pane = card("/Pane", -0.7, opacity=0.0, tint=(0.9, 1.0, 0.9), roughness=0.0)
    return of_shot(described(pane, card("/Mirror", 0.7, metallic=1.0, roughness=0.0)), max_depth=4)


@kind
def a_lens() -> Picture:
    return of_shot(described(lens=0.05))


@kind
def deep_pictures() -> Picture:
    return of_shot(described(card("/Card")), deep=True)


@kind
def coloured_smoke() -> Picture:
    smoke = cube_of(cloud(color=(1.0, 0.6, 0.3), resolution=6))
    spot = {"type": "spot", "to_world": mi.ScalarTransform4f().look_at([2, 3, 1], [0, 0, 0], [0, 1, 0]),
            "intensity": rgb(30.0), "cutoff_angle": 30}  # fmt: skip
    return of_plugin(load(fog=smoke, spot=spot, sensor=camera(size=48)), method="beams")


@pytest.mark.parametrize("name", KINDS)
def test_another_seed_and_size_of_a_kind_compile_no_kernel_twice(name):
    holds(KINDS[name]())


@pytest.mark.parametrize("name", sweep(SHOTS, keep={"keyhole/keyhole"}))
def test_another_seed_and_size_of_a_shot_compile_no_kernel_twice(name):
    holds(of_shot(pb.Shot.open(EXAMPLES / f"{name}.usda")))


@pytest.mark.parametrize("name", sweep(SCENES, keep={"cornell_fog"}))
def test_another_seed_and_size_of_a_mitsuba_scene_compile_no_kernel_twice(name):
    holds(of_plugin(mi.load_file(str(EXAMPLES / "mitsuba" / f"{name}.xml"))))


def holds(picture: Picture) -> None:
    before = {without_constants(kernel) for kernel in compiled(picture, *FIRST)}
    for seed, width in OTHERS:
        gc.collect()  # plug-ins that are garbage have their places in the tables, too
        codes = [without_constants(kernel) for kernel in compiled(picture, seed, width)]
        assert not before.intersection(codes), (seed, width)
        before.update(codes)
