"""Walls stop the light of wide scattered beams, which keep it: none shines through, and none is lost."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.numerics.arrays import to_vectors
from photonbeams.render.scene_frame import begin
from photonbeams.runtime.device import Bool, Float, UInt32, mitsuba
from photonbeams.transport.segments.beams import Cutting
from photonbeams.transport.segments.records import Segments
from photonbeams.transport.segments.sides import sides_of
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import T, by_beams, camera, fog, load, rgb
from tests.helpers.sweep import sweep

mi = mitsuba()


def placed(rng):
    """Return a random place, turn and scale, and the scale."""
    scale = float(10 ** rng.uniform(-1.5, 1.5))
    axis = rng.normal(size=3).tolist()
    return T().translate((scale * rng.normal(size=3)).tolist()).rotate(axis, rng.uniform(0, 360)).scale(scale), scale


def walls(to_world, medium, reflectance=0.7, **more):
    """Return the six sides of the cube [−1, 1]³, without thickness, facing a medium inside."""
    turns = [([1, 0, 0], angle) for angle in (0, 90, 180, 270)] + [([0, 1, 0], 90), ([0, 1, 0], 270)]
    bsdf = {"type": "diffuse", "reflectance": rgb(reflectance)}
    return {
        f"wall{number}": {
            "type": "rectangle", "to_world": to_world.rotate(axis, angle).translate([0, 0, -1]), "bsdf": bsdf,
            "exterior": medium, **more,
        }
        for number, (axis, angle) in enumerate(turns)
    }  # fmt: skip


def simulated(scene, **given):
    settings = by_beams(guiding=False, **given)
    light = begin(scene, scene.sensors()[0], settings).light
    return light.simulation.simulated([light.world], 0)[0]


@pytest.mark.parametrize("thickness", sweep([0.0, 0.02], keep=[0.02]))
def test_no_light_shines_through_a_thin_wall(thickness, rng):
    """Of two rooms beside each other the one without a lamp stays dark, as seen along lines through the middle of it.

    Beams have radii of 0.1, and the wall between the rooms is at most 0.02 thick.
    """
    to_world, scale = placed(rng)
    medium = mi.load_dict(fog(1.0 / scale, 1.0))
    bsdf = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(0.7)}}
    wall = {"type": "cube", "to_world": to_world.scale([thickness / 2, 1, 1]), "bsdf": bsdf, "exterior": medium}
    if not thickness:
        wall = {"type": "rectangle", "to_world": to_world.rotate([0, 1, 0], 90), "bsdf": bsdf}
    lamp = {"type": "point", "position": list(to_world @ mi.ScalarPoint3f(-0.6, 0.3, 0.2)), "intensity": rgb(1.0)}
    sensor = camera(list(to_world @ mi.ScalarPoint3f(0.5, 0.5, 0.5)), list(to_world @ mi.ScalarPoint3f(0.5, 0, 0)))
    scene = load(
        **walls(to_world, medium), wall=wall, lamp={**lamp, "medium": medium}, sensor={**sensor, "medium": medium}
    )
    sets = simulated(scene, max_depth=6, max_radius=0.1 * scale, min_radius=0.1 * scale, beams=4096)

    def light(low, high):
        """Return the mean radiance along lines between random points of a box in the cube."""
        ends = rng.uniform(low, high, (2, 4000, 3))
        matrix = np.array(to_world.matrix)
        start, end = ends @ matrix[:3, :3].T + matrix[:3, 3]
        length = np.linalg.norm(end - start, axis=1)
        inner = pb.Medium(1.0 / scale)
        return sum(
            float(np.mean(pb.estimate(each.beams, start, end - start, length, medium=inner, estimator="frustum")))
            for each in sets
        )

    edge = thickness / 2 + 1e-3
    lit, dark = light([-0.99, -0.99, -0.99], [-edge, 0.99, 0.99]), light([edge, -0.99, -0.99], [0.99, 0.99, 0.99])
    assert lit > 0
    # Beams in a corner, beside two walls, may pass the third: few have room for that.
    assert dark < 2e-3 * lit


def test_beams_in_a_closed_room_keep_their_light(rng, monkeypatch):
    """What scattered beams have before the planes that cut them, in the room, is what they have without a width."""
    to_world, scale = placed(rng)
    medium = mi.load_dict(fog(0.5 / scale, 1.0))
    lit = walls(to_world, medium, 0.8, emitter={"type": "area", "radiance": rgb(1.0)})
    inside = camera(list(to_world @ mi.ScalarPoint3f(0, 0, 0)), list(to_world @ mi.ScalarPoint3f(1, 0, 0)))
    shares = []

    def weighed(cutting, world, segments, fitted=Cutting.fitted):
        result = fitted(cutting, world, segments)
        beams = cutting._beams(
            result, 0.0, (Float(0), result.length), [cutting._radius(result, s, result.narrow) for s in (0, 0)],
            result.normal,
        )  # fmt: skip
        scattered = segments.depth.numpy() > 0
        if scattered.any():
            shares.append(kept(beams, segments, np.array(to_world.matrix), 0.5 / scale, rng)[:, scattered])
        return result

    monkeypatch.setattr(Cutting, "fitted", weighed)
    scene = load(**lit, sensor={**inside, "medium": medium})
    simulated(scene, max_depth=12, max_radius=0.12 * scale, min_radius=0.12 * scale, beams=8192)
    light, whole = np.concatenate(shares, axis=1)
    # In a corner, beside three walls or four, a beam may still pass one of them, and lose what is behind.
    assert light.sum() == pytest.approx(whole.sum(), rel=3e-3)
    assert whole.sum() > 0


def kept(beams, segments, matrix, extinction, rng, tries=64):
    """Return the light of beams that is in the cube, at random points in each, and that of their axes, (2, N)."""
    start, end, power, normal, first, side, beside = (
        np.array(each, dtype=np.float64).T
        for each in (
            beams.start, beams.end, beams.power, beams.end_normal, beams.start_normal, beams.side, beams.side_normal
        )
    )  # fmt: skip
    length, radius = np.linalg.norm(end - start, axis=1), np.array(beams.radius_start, dtype=np.float64)
    axis = (end - start) / length[:, None]
    across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    across /= np.linalg.norm(across, axis=1)[:, None]
    far = 1 - np.exp(-extinction * (length + radius))  # beams reach a radius beyond the slanted walls that stop them
    total = np.zeros(len(length))
    for _ in range(tries):
        s = -np.log(1 - rng.random(len(length)) * far) / extinction
        rho, angle = radius * np.sqrt(1 - np.sqrt(1 - rng.random(len(s)))), 2 * np.pi * rng.random(len(s))
        aside = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
        point = start + s[:, None] * axis + rho[:, None] * aside
        there = np.all(np.abs((point - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T) <= 1 + 1e-6, axis=1)
        for place, plane in ((start, first), (end, normal), (side, beside)):
            there &= np.sum((point - place) * plane, axis=1) >= -1e-6 * length
        total += there * far / tries
    flux = np.array(segments.flux.x, dtype=np.float64)
    return np.stack([power[:, 0] * total, flux * (1 - np.exp(-extinction * length))])


def found_by(room, height, count):
    """Return the walls beside beams of radius 0.2 along x, at a height z, each with a turn of its own."""
    segments = Segments()
    segments.origin = to_vectors(np.tile([-1, 0, height], (count, 1)))
    segments.direction = to_vectors(np.tile([1.0, 0, 0], (count, 1)))
    segments.normal, segments.length = -segments.direction, dr.full(Float, 2.0, count)
    segments.index, segments.key = dr.arange(UInt32, count), dr.zeros(UInt32, count)
    segments.depth = dr.full(UInt32, 1, count)
    radius = dr.full(Float, 0.2, count)
    return sides_of(room.intersect, segments, (radius, radius), Bool(True))


@pytest.mark.parametrize("distance, thickness, cut", [(0.3, 0.0, True), (0.3, 0.5, True), (1.2, 0.0, False)])
def test_the_wall_beside_a_beam_is_found(distance, thickness, cut):
    """A beam of radius 0.2 along a wall is cut by its plane if it is nearer than a radius, whatever its turn is."""
    place = T().translate([0, 0, -thickness / 2])
    wall = {"type": "cube", "to_world": place.scale([5, 5, max(thickness / 2, 1e-3)])}
    room = world_of_plugin(load(wall=wall, sensor=camera()), None)
    top = 0.0 if thickness else 1e-3
    found = found_by(room, top + 0.2 * distance, 500)
    expected = [0, 0, 1] if cut else [0, 0, 0]
    assert np.allclose(found.beside.numpy().T, expected, atol=1e-6)
    assert not np.any(found.start.numpy())
    if cut:
        assert np.allclose(found.place.z.numpy(), top, atol=1e-5)


def test_of_two_walls_the_thin_one_cuts_a_beam():
    """A thick wall does not let light through, so the plane is that of a thin wall, although it is farther."""
    thick = {"type": "cube", "to_world": T().translate([0, 0, -0.5]).scale([5, 5, 0.5])}
    thin = {"type": "cube", "to_world": T().translate([0, 0.102, 1.01]).scale([5, 0.002, 1])}
    room = world_of_plugin(load(thick=thick, thin=thin, sensor=camera()), None)
    found = found_by(room, 0.05, 200).beside.numpy().T
    # Five directions are tried, and one is within 36 degrees of that to the wall: it passes the wall 0.8 radii away.
    assert np.allclose(found, [0, -1, 0], atol=1e-6)
