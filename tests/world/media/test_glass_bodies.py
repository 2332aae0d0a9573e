"""Closed bodies of glass on stages: no fog is in them, whatever is around them and however their faces wind."""

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.runtime.device import Bool, UInt32
from photonbeams.world.described import world_of_scene
from photonbeams.world.media.stage_media import around_glass, media_of
from tests.helpers.comparison import box, quad
from tests.helpers.shading import shade

GLASS = scene.Material(diffuse=(1.0,) * 3, opacity=0.0, ior=1.5, roughness=0.0)
FOG = scene.Medium((0.3,) * 3, name="/Fog")


def ball(center, radius, inward=False, normals=0, rows=12):
    """Return a ball of glass; `normals` is their factor: 0 for none."""
    theta, phi = np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    unit[0], unit[-1] = [0, 0, 1], [0, 0, -1]
    i, j = np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij")
    a, b = i * 2 * rows + j, i * 2 * rows + (j + 1) % (2 * rows)
    below = 2 * rows
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in (
        (a, a + below, b + below), (a, b + below, b))])  # fmt: skip
    unit = unit.reshape(-1, 3)
    normals = normals * unit if normals else None
    faces = faces[:, ::-1] if inward else faces
    return scene.Mesh("/Ball", center + radius * unit, faces, normals=normals, material=GLASS)


def draw(seed):
    """Return a ball's centre and radius, its mesh, and media: in all of space or a room, and in the ball."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-2, 2)
    center, radius = scale * rng.uniform(-5, 5, 3), scale * rng.uniform(0.3, 1)
    mesh = ball(center, radius, bool(rng.integers(2)), rng.integers(-1, 2))
    strength = (0.3 / scale,) * 3
    room = box("/Room", center - 3 * scale, center + 4 * scale) if seed % 2 else None
    media = [scene.Medium(strength, mesh=room, name="/Fog")]
    if seed % 3 == 0:
        media.append(
            scene.Medium(strength, mesh=box("/Drop", center - 0.3 * radius, center + 0.3 * radius), name="/Drop")
        )
    return center, radius, mesh, media


@pytest.mark.parametrize("seed", range(6))
def test_no_fog_is_in_glass(seed):
    center, radius, mesh, media = draw(seed)
    world = world_of_scene(scene.Scene((mesh,), media=tuple(media)), sharp=True)
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(4096, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = radius * rng.uniform(0, 2.2, 4096)
    points = center + distance[:, None] * direction
    found = world.medium_at(to_vectors(points), to_vectors(direction[::-1]), Bool(True)).numpy()
    fog, drop = world.numbers["/Fog"], world.numbers.get("/Drop", 0)
    in_drop = (np.abs(points - center) < 0.3 * radius).all(axis=1) & (len(media) > 1)
    inside, outside = distance < 0.95 * radius, distance > radius  # between them is the facets' sagitta
    assert np.all(found[outside] == fog)
    assert np.all(found[inside & in_drop] == drop)
    assert np.all(found[inside & ~in_drop] == 0)
    # Refracted rays change the medium, and those that are reflected stay in theirs.
    for start, along, sides in ((center, 1, (fog, 0)), (center + 2 * radius * direction, -1, (0, fog))):
        origin, ray = to_vectors(np.broadcast_to(start, points.shape)), to_vectors(along * direction)
        hit = world.solids.first(origin, ray, Bool(True), UInt32(0))
        for turn, expected in zip((1, -1), sides, strict=True):
            entered = world.media.beyond(hit, to_vectors(turn * along * direction), UInt32(sides[1]), Bool(True))
            assert np.all(entered.numpy() == expected)


@pytest.mark.parametrize("inward", [False, True])
def test_glass_takes_its_length_from_the_fog(inward):
    # A ray meets a cube of glass straight on: (1 − R) / (1 + R) of the light passes, by all reflections in the glass.
    cube = box("/Cube", [-1] * 3, [1] * 3, GLASS)
    if inward:
        cube = scene.Mesh("/Cube", cube.points, np.asarray(cube.faces)[:, ::-1], material=GLASS)
    glowing = scene.Material(diffuse=scene.BLACK, ior=1.0, emissive=(1.0,) * 3)
    wall = quad("/Wall", [[-9, -9, -4], [9, -9, -4], [9, 9, -4], [-9, 9, -4]], glowing)
    smog = scene.Medium(scene.BLACK, absorption=(0.1, 0.2, 0.4), name="/Smog")
    world = world_of_scene(scene.Scene((cube, wall), media=(smog,)), viewpoints=[(0, 0, 4)], sharp=True)
    rays = (to_vectors(np.broadcast_to(each, (4096, 3))) for each in ([0.1, 0.2, 4.0], [0.0, 0.0, -1.0]))
    found = shade(world, *rays, dr.arange(UInt32, 4096), max_depth=16).radiance.numpy().mean(axis=1)
    expected = np.exp(-6 * np.array(smog.extinction)) * (1 - 0.04) / (1 + 0.04)
    assert np.allclose(found, expected, rtol=0.01)


def test_glass_that_is_open_or_partly_in_a_medium_is_filled_as_what_is_around_it(caplog):
    pane = quad("/Pane", [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], GLASS)
    world = world_of_scene(scene.Scene((pane, ball([5, 0, 0], 1.0)), media=(FOG,)), sharp=True)
    assert set(world.parts.media.outside) == {"/Ball"}
    tank = scene.Medium((0.3,) * 3, mesh=box("/Tank", [-4] * 3, [0.3, 4, 4]), name="/Tank")
    body = ball([0, 0, 0], 1.0)
    assert around_glass(media_of([tank]), [body]) == {}
    (record,) = caplog.records
    assert record.getMessage() == "glass /Ball is partly in /Tank: expected all of it inside, or outside"
