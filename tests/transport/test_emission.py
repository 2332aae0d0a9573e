"""Light paths at their emitters: power, and derivatives against finite differences."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.sampling import pairs
from photonbeams.runtime.device import mitsuba
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.tracing import emission_of

mi = mitsuba()
AREA = {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.0, 1.0]}}}
EMITTERS = {
    "point": {"type": "point", "intensity": {"type": "rgb", "value": [3.0, 2.0, 1.0]}},
    "spot": {"type": "spot", "cutoff_angle": 30.0},
    "directional": {"type": "directional", "direction": [0, 0, 1]},
    "constant": {"type": "constant"},
    "envmap": {"type": "envmap", "bitmap": mi.Bitmap(np.random.default_rng(1).random((16, 32, 3)).astype(np.float32))},
    "projector": {"type": "projector", "irradiance": {"type": "rgb", "value": 1.0}},
    "rectangle": {"type": "rectangle", **AREA},
    "sphere": {"type": "sphere", **AREA},
    "disk": {"type": "disk", **AREA},
    "cylinder": {"type": "cylinder", **AREA},
    "mesh": {"type": "cube", **AREA},
}
# Fluxes by integration: 4π I of a point, π A L of a surface.
FLUX = {
    "point": 4 * np.pi, "rectangle": np.pi * 4, "sphere": np.pi * 4 * np.pi, "disk": np.pi * np.pi,
    "cylinder": np.pi * 2 * np.pi, "mesh": np.pi * 24,
}  # fmt: skip


def scene_of(emitter):
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, 5]).scale(3)}
    return mi.load_dict({"type": "scene", "emitter": emitter, "floor": floor})


@pytest.mark.parametrize("name", FLUX)
def test_paths_carry_the_power_of_their_emitter(name):
    (emitted,) = emission_of(world_of_plugin(scene_of(EMITTERS[name]), None), 1024).emit(0)
    # Weights of these emitters are the same for all directions: only rounding is left.
    np.testing.assert_allclose(emitted.flux.numpy().sum(axis=1), FLUX[name] * np.array([3, 2, 1]), rtol=1e-4)


@pytest.mark.parametrize("name", ["constant", "directional"])
def test_light_from_infinity_falls_on_meshes_that_mitsuba_merged(name):
    """Light from infinity falls on merged floors as on separate ones, although Mitsuba forgets their box."""
    wall = {"type": "diffuse"}
    floors = {
        f"floor{x}": {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([x, 0, 5]), "bsdf": wall}
        for x in (-7, 4)
    }
    scenes = [
        mi.load_dict({"type": "scene", "emitter": EMITTERS[name], **floors}, optimize=merged)
        for merged in (False, True)
    ]
    assert [len(each.shapes()) for each in scenes] == [2, 1]
    apart, merged = (emission_of(world_of_plugin(each), 64).emit(0)[0] for each in scenes)
    np.testing.assert_allclose(merged.origin.numpy(), apart.origin.numpy(), rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(merged.flux.numpy(), apart.flux.numpy(), rtol=1e-3)


@pytest.mark.parametrize("name", EMITTERS)
def test_tangents_are_the_derivatives_of_rays(name):
    count, step = 64, 1e-3
    world = world_of_plugin(scene_of(EMITTERS[name]))
    (stratum,) = emission_of(world, count).strata
    emitted, base = stratum.emit(0), stratum.points(0).T

    def rays(numbers):
        rays = world.emitters[0].lamp.emit(*pairs(numbers.T), world.bounds)
        return [np.broadcast_to(np.array(each), (3, count)) for each in (rays.origin, rays.direction)]

    for k, differentials in enumerate(emitted.differentials.columns()):
        shift = step * np.eye(4)[k][:, None]
        for tangent, high, low in zip(differentials, rays(base + shift), rays(base - shift), strict=True):
            expected = (high - low) / (2 * step)
            found = np.broadcast_to(np.array(tangent), (3, count))
            # The median, because differences are wrong near a fold of a map or the edge of a pixel or a triangle.
            # Elsewhere their error is the third derivative times step², plus rounding divided by the step.
            error = np.abs(found - expected).max(axis=0)
            assert np.median(error) < 1e-3 * max(1, np.abs(expected).max())


def test_emitters_share_paths_by_their_power():
    emitters = {
        "weak": {"type": "point", "position": [0, 0, 1], "intensity": {"type": "rgb", "value": 1.0}},
        "strong": {"type": "point", "position": [0, 0, 2], "intensity": {"type": "rgb", "value": 3.0}},
        "dark": {"type": "point", "position": [0, 0, 3], "intensity": {"type": "rgb", "value": 0.0}},
    }
    scene = mi.load_dict({"type": "scene", **emitters})
    emitted = emission_of(world_of_plugin(scene), 1000).emit(0)
    heights = {round(float(each.origin.z.numpy()[0])): dr.width(each.origin) for each in emitted}
    assert heights == {1: 250, 2: 750}
