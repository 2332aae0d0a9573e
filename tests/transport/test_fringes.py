"""Light straight from a lamp has its fluence everywhere in a fog: at faces and in corners, far away and close by."""

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.world.described import world_of_scene
from tests.helpers.comparison import box
from tests.helpers.tracing import trace
from tests.transport.fluences import estimated, lamp, unit

UNIT = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
PASSES = 5


KINDS = ("point", "sphere", "rectangle", "disk", "cylinder", "0.5", "60", "180")


def draw(kind, rng):
    """Return the ratio of estimated to right fluence at the corners and inside of a fog, for each pass, (passes, 2)."""
    scale = 10 ** rng.uniform(-2, 2)
    place, half = scale * rng.uniform(-30, 30, 3), scale * 10 ** rng.uniform(-0.7, 0.7, 3)
    center = place + np.linalg.norm(half) * (1.5 + 3 * rng.random()) * unit(rng)
    light, fluence_at = lamp(kind, center, 0.2 * scale, rng, place)
    fog = scene.Medium(1e-6 / scale, mesh=box("/fog", place - half, place + half))
    world = world_of_scene(scene.Scene(lights=[light], media=[fog]))
    points = place + half * np.concatenate([0.99 * UNIT, rng.uniform(-1, 1, (8, 3))])
    passes = [trace(world, beams_per_light=1 << 12, pass_index=number, overlap=2.2) for number in range(PASSES)]
    ratios = np.array([estimated(each, points) for each in passes]) / fluence_at(points)
    return np.stack([ratios[:, :8].mean(axis=1), ratios[:, 8:].mean(axis=1)], axis=1)


def test_fluence_is_right_in_the_corners_of_fogs_of_any_size_and_place():
    """Beams may be far wider than the fog. The fewer of them reach it, the more their estimate spreads.

    Passes continue one sequence, so that the spread of the passes' mean is less than if they were independent.
    """
    rng = np.random.default_rng(0)
    found = np.array([draw(kind, rng) for kind in KINDS for _ in range(3)])  # (draws, passes, 2)
    mean, error = found.mean(axis=1), found.std(axis=1) / np.sqrt(PASSES)
    assert np.all(np.abs(mean - 1) < np.maximum(4 * error, 0.015))
    # Of 4,096 beams from half of the sky, each as wide as the fog is large, a few per cent of the rim are cut off.
    weights = 1 / np.maximum(error, 0.003) ** 2
    assert np.sum(weights * mean, axis=0) / np.sum(weights, axis=0) == pytest.approx([1, 1], abs=0.005)


def test_a_lamp_that_moves_has_the_beams_beside_a_fog_of_one_that_stands_still():
    fog, bounds = scene.Medium(1e-6, mesh=box("/fog", (-0.2,) * 3, (0.2,) * 3), name="/fog"), (np.zeros(3), 4.0)
    worlds = [
        world_of_scene(
            scene.Scene(lights=[scene.SphereLight("/l", 1.0, center=(0, height, 0))], media=[fog], bounds=bounds)
        )
        for height in (3.0, 3.01)
    ]
    still, moving = (trace(worlds[0], overlap=2.2, close=close) for close in (None, worlds[1]))
    points = 0.19 * UNIT
    assert estimated(moving, points) == pytest.approx(estimated(still, points), rel=1e-6)
    assert all(each.close is not None for each in moving)


def reentrant(shape, rng, scale, place):
    """Return a fog that lines leave and enter again, media with it, and points of it, (N, 3)."""
    half = scale * 10 ** rng.uniform(-0.3, 0.3, 3)
    whole = box("/fog", place - half, place + half)
    points = place + half * rng.uniform(-1, 1, (400, 3))
    if shape == "nested":
        inner = 0.6 * half
        fog = scene.Medium(1e-6 / scale, mesh=whole, name="/fog")
        other = scene.Medium(2e-6 / scale, mesh=box("/inner", place - inner, place + inner), name="/inner")
        return fog, [fog, other], points[np.any(np.abs(points - place) > inner, axis=1)][:12]
    # Two boxes: the thirds at the ends.
    parts = [box("/fog", *ends) for ends in ((place - half, place + half * (-1 / 3, 1, 1)),
                                             (place + half * (1 / 3, -1, -1), place + half))]  # fmt: skip
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].points)])
    mesh = scene.Mesh("/fog", np.concatenate([each.points for each in parts]), faces)
    fog = scene.Medium(1e-6 / scale, mesh=mesh, name="/fog")
    return fog, [fog], points[np.abs(points - place)[:, 0] > half[0] / 3][:12]


@pytest.mark.parametrize("shape", ["nested", "parts"])
def test_fluence_is_right_in_fogs_that_lines_leave_and_enter_again(shape):
    """Beams are wider than the gaps in the fog: what lies beside a gap belongs to one of the two segments around it.

    Beside an inner fog there was 1.06 of the light; in a fog of two parts, 0.9.
    """
    rng = np.random.default_rng(3)
    found = []
    for kind in ("point", "rectangle", "disk", "60"):
        scale = 10 ** rng.uniform(-2, 2)
        place = scale * rng.uniform(-30, 30, 3)
        fog, media, points = reentrant(shape, rng, scale, place)
        center = place + scale * (4 + 2 * rng.random()) * unit(rng)
        light, fluence_at = lamp(kind, center, 0.5 * scale, rng, place)
        world = world_of_scene(scene.Scene(lights=[light], media=media))
        passes = [trace(world, beams_per_light=1 << 10, pass_index=number, overlap=2.2) for number in range(PASSES)]
        own = [[each for each in sets if each.medium == world.numbers[fog.name]] for sets in passes]
        found.append(np.mean([estimated(each, points) for each in own], axis=1) / fluence_at(points).mean())
    found = np.array(found)
    mean, error = found.mean(axis=1), found.std(axis=1) / np.sqrt(PASSES)
    assert np.all(np.abs(mean - 1) < np.maximum(4 * error, 0.02))
    weights = 1 / np.maximum(error, 0.005) ** 2
    assert np.sum(weights * mean) / np.sum(weights) == pytest.approx(1, abs=0.01)
