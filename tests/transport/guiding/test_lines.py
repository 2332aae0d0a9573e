"""Lines from lamps to fog that cameras see."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.scene import Medium, Mesh, Scene
from photonbeams.transport.guiding.lines import LightLines
from photonbeams.world.cameras.cameras import View, Window
from photonbeams.world.described import world_of_scene


def test_fog_that_is_thin_beside_the_rest_of_its_rays_is_found():
    """Rays are 500 long; 0.1 of that is in the fog, which fills a fifth of the picture."""
    far = Mesh("/Wall", [[-500, -500, -500], [500, -500, -500], [0, 800, -500]], [[0, 1, 2]])
    fog = Medium(scattering=1, mesh=Mesh.box("/Puff", [-0.05] * 3, [0.05] * 3))
    lamp = pb.scene.SphereLight("/Lamp", 1.0, center=(0, 1, 0))
    camera = pb.scene.Camera.look_at((0, 0, 0.4), (0, 0, 0))
    world = world_of_scene(Scene(far, lamp, media=fog), [np.array([0, 0, 0.4])])
    points = LightLines(world, View(camera, Window.full(16, 9)).projections).fog
    assert points is not None
    assert len(np.ravel(points.light.numpy())) > 1000
    assert np.abs(points.position.numpy()).max() < 0.051


def test_the_sun_finds_small_smoke_above_a_ground_of_any_size():
    """Its rays begin as far away as the ground reaches, where single precision rounds them by a part of the smoke."""
    fog = Medium(scattering=3, mesh=Mesh.box("/Puff", [-0.1, 0.5, -0.1], [0.1, 0.7, 0.1]))
    sun = pb.scene.DistantLight("/Sun", 50000.0, axis=(0.28, -0.94, 0.19))
    camera = pb.scene.Camera.look_at((0, 0.6, 1), (0, 0.6, 0))

    def light(half):
        corners = [[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]]
        ground = Mesh("/Ground", corners, [[0, 1, 2], [0, 2, 3]])
        shot = pb.Shot(Scene(ground, sun, media=fog), camera)
        return shot.render(passes=2, width=32, height=18, surfaces=False).layers["beams"].mean()

    assert light(40_000) == pytest.approx(light(4), rel=0.02) and light(4) > 0
