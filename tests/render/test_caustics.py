"""Light through glass into fog, against Mitsuba's path tracer, with a lamp that is large enough for it to find."""

import numpy as np
import pytest

from photonbeams.render.scene_frame import render
from photonbeams.runtime.device import Float, UInt32, mitsuba
from tests.helpers.mitsuba_scenes import T, by_beams, camera, fog, frames, load, rgb
from tests.helpers.references import blocks, reference
from tests.helpers.sweep import sweep

mi = mitsuba()
SEEDS = 4


def lens(radius=0.8, sphere=1.4, rings=48, sides=96):
    """Return a biconvex lens around the z axis, a mesh with smooth sides; the radii are of its rim and its spheres."""
    depth = np.sqrt(sphere**2 - radius**2)
    r = radius * np.linspace(0, 1, rings + 1)[1:, None]
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None]
    points, normals, faces = [], [], []
    for side in (1, -1):
        first = sum(map(len, points))
        z = np.sqrt(sphere**2 - r**2) - depth + 0 * angle
        around = np.stack([r * np.cos(angle), r * np.sin(angle), side * z], axis=-1).reshape(-1, 3)
        own = np.concatenate([[[0, 0, side * (sphere - depth)]], around])
        points.append(own)
        normals.append((own + np.array([0, 0, side * depth])) / sphere)
        for k in range(sides):
            following = (k + 1) % sides
            faces.append([first, first + 1 + k, first + 1 + following][::side])
            for ring in range(rings - 1):
                a, b = (first + 1 + ring * sides + each for each in (k, following))
                faces += [[a, a + sides, b][::side], [b, a + sides, b + sides][::side]]
    return np.concatenate(points), np.concatenate(normals), np.array(faces)


def mesh(points, normals, faces, bsdf, medium):
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(bsdf)
    properties["exterior"] = medium
    shape = mi.Mesh("lens", len(points), len(faces), props=properties, has_vertex_normals=True)
    parameters = mi.traverse(shape)
    parameters["vertex_positions"], parameters["vertex_normals"] = Float(points.ravel()), Float(normals.ravel())
    parameters["faces"] = UInt32(faces.ravel())
    parameters.update()
    return shape


def scene_with(name):
    """Return fog, a lamp of some size behind glass, and a camera that sees the glass and the light behind it."""
    medium = mi.load_dict(fog(0.2, 0.9))
    glass = {"type": "dielectric", "int_ior": 1.5}
    lamp = {"type": "sphere", "center": [0, 0, -4], "radius": 0.5,
            "emitter": {"type": "area", "radiance": rgb(40.0)}}  # fmt: skip
    if name == "ball":
        body = {"type": "sphere", "radius": 0.8, "bsdf": glass, "exterior": medium}
    else:
        body = mesh(*lens(), glass, medium)
    sensor = camera((4, 0.5, 1.0), (0, 0, 1.0), size=16, fov=45, medium=medium)
    return load(glass=body, lamp=lamp, sensor=sensor)


@pytest.mark.parametrize("name", sweep(["ball", "lens"], keep=["ball"]))
def test_light_through_glass_is_where_it_should_be(name):
    scene = scene_with(name)
    settings = by_beams(passes=2, beams=1 << 15, max_depth=8, max_radius=0.05, guiding=False)
    ours = np.array([each.layers()["rgba"][..., 0] for each in frames(scene, settings, SEEDS)])
    theirs = reference(f"caustics/{name}", scene, 4096, SEEDS, max_depth=8)[..., 0]
    assert abs(ours.mean() / theirs.mean() - 1) < 0.02 + 4 * _error(ours) + 4 * _error(theirs)
    # In blocks of 4 x 4 pixels, the focus behind the glass and the fog around it are as bright as in the reference.
    found = [blocks(ours[..., None])[..., 0], theirs]
    center = [each.mean(axis=0) for each in found]
    error = np.sqrt(sum(each.std(axis=0, ddof=1) ** 2 / SEEDS for each in found))
    typical = np.maximum(error, np.median(error / center[1]) * center[1])
    # In addition to noise, beams with radii of at most 0.05 blur pixels of 0.2.
    assert (np.abs(center[0] - center[1]) < 4.5 * typical + 0.03 * center[1].max()).all()


def _error(pictures):
    """Return the relative standard error of the mean over all pictures."""
    means = pictures.mean(axis=(1, 2))
    return means.std(ddof=1) / means.mean() / np.sqrt(len(means))


def test_a_small_lamp_makes_a_bright_focus():
    """A lamp without size, which a path tracer cannot find, makes a bright focus behind the ball, on the axis."""
    medium = mi.load_dict(fog(0.05, 0.9))
    ball = {"type": "sphere", "radius": 0.8, "bsdf": {"type": "dielectric", "int_ior": 1.5}, "exterior": medium}
    spot = {"type": "spot", "to_world": T().look_at([0, 0, -6], [0, 0, 0], [0, 1, 0]), "intensity": rgb(20.0),
            "cutoff_angle": 7.0, "beam_width": 7.0}  # fmt: skip
    scene = load(ball=ball, spot=spot, sensor=camera((6, 0, 1.2), (0, 0, 1.2), size=48, fov=20, medium=medium))
    picture = render(scene, scene.sensors()[0], by_beams(passes=4, max_depth=6)).layers()["beams"][..., 0]
    # The camera looks along −x with +y up: z is horizontal in the picture, and the axis is in the middle rows.
    rows = picture.max(axis=1)
    assert abs(int(rows.argmax()) - 23.5) < 2
    assert picture.max() > 10 * np.median(picture[picture > 0])
