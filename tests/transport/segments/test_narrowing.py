"""Beams that a surface stops, or whose rim it blocks, are as bright and as wide before it as if it were not there."""

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.world.described import world_of_scene
from tests.helpers.comparison import quad
from tests.helpers.tracing import trace
from tests.transport.fluences import estimated, lamp

LAMP, EDGE = np.array([0.0, 3.0, 0.0]), np.array([2.0, 0.0, 0.0])
GROUND = quad("/ground", [[-4, 0, -4], [-4, 0, 4], [2, 0, 4], [2, 0, -4]])


def ball(center, radius, steps=24):
    """Return a sphere as a mesh."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * steps + 1), np.linspace(0, np.pi, steps + 1))
    points = np.stack([np.sin(v) * np.cos(u), np.cos(v), np.sin(v) * np.sin(u)], axis=-1).reshape(-1, 3)
    first = (np.arange(steps)[:, None] * (2 * steps + 1) + np.arange(2 * steps)).ravel()
    faces = np.concatenate([first[:, None] + [0, 1, 2 * steps + 2], first[:, None] + [0, 2 * steps + 2, 2 * steps + 1]])
    return scene.Mesh("/ball", np.asarray(center) + radius * points, faces)


@pytest.mark.parametrize("kind", ["point", "sphere", "rectangle"])
@pytest.mark.parametrize("blocker", [GROUND, ball(EDGE, 0.5)], ids=["edge", "ball"])
def test_no_line_runs_along_a_shaft_to_a_silhouette(kind, blocker):
    """Fluence between a lamp and a silhouette is what it is without the blocker, on either side of the silhouette.

    The points lie on lines across the shaft, before the beams' rims meet the blocker. Narrow beams next to wide ones
    would make the light near the silhouette a tenth too bright there.
    """
    light, _ = lamp(kind, LAMP, 0.3, np.random.default_rng(1), EDGE)
    fog, bounds = scene.Medium(1e-6), (np.zeros(3), 6.0)

    def traced(*meshes):
        world = world_of_scene(scene.Scene(lights=[light], meshes=list(meshes), media=[fog], bounds=bounds))
        return trace(world, beams_per_light=1 << 12, overlap=2.2)

    towards = EDGE - LAMP
    across = np.cross(towards, [0.0, 0.0, 1.0]) / np.linalg.norm(towards)
    rim = 0.5 * across if blocker is not GROUND else 0
    points = np.concatenate(
        [LAMP + part * (towards + rim) + part * 0.4 * np.linspace(-1, 1, 17)[:, None] * across for part in (0.3, 0.6)]
    )
    without, found = estimated(traced(), points), estimated(traced(blocker), points)
    assert np.all(without > 0)
    assert found == pytest.approx(without, rel=0.01)  # the least radius of beams ends where they do


def test_light_beside_a_shadow_is_even_up_to_half_a_radius_from_its_edge():
    """The edge is soft by half of a radius; neither a halo nor a bright line runs along it.

    Radii that grow from a half to one between two and four radii from the edge make light there 0.96 to 1.05 of what it
    should be. If all changed in the same steps, it would be 0.92 to 1.08, and within one radius, 0.82 to 1.23. Eight
    passes at twelve places give the mean of a point to 2 %.
    """
    light, fog, bounds = scene.SphereLight("/l", 1.0, center=LAMP), scene.Medium(1e-6), (np.zeros(3), 6.0)
    towards = EDGE - LAMP
    across = np.cross(towards, [0.0, 0.0, 1.0]) / np.linalg.norm(towards)
    places = [[0, 0, z] for z in np.linspace(-0.6, 0.6, 12)]
    offsets = np.linspace(-0.7, 0.2, 31)
    points = (LAMP + 1.5 * towards + offsets[:, None, None] * across + places).reshape(-1, 3)

    def profile(*meshes):
        world = world_of_scene(scene.Scene(lights=[light], meshes=list(meshes), media=[fog], bounds=bounds))
        passes = [
            estimated(trace(world, beams_per_light=1 << 14, pass_index=number, overlap=2.2), points)
            for number in range(8)
        ]
        return np.mean(passes, axis=0).reshape(len(offsets), -1).mean(axis=1)

    radius = 0.16  # of beams at the points
    ratio = profile(GROUND) / profile()
    assert ratio[offsets < -0.6 * radius] == pytest.approx(1, abs=0.07)
    assert np.all(ratio[offsets > 0.6 * radius] < 0.02)
