"""Fog without an end: its light against quadrature, at any scale and place, and against `volpath`."""

import logging

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba
from tests.helpers.references import reference
from tests.helpers.sweep import sweep
from tests.helpers.usda import prim

mi = mitsuba()
T = mi.ScalarTransform4f
WIDTH, HEIGHT, SAMPLES = 12, 8, 4
FOG = {"type": "ref", "id": "fog"}


class View:
    """A random point lamp and a random camera in endless fog, often with the lamp beside or behind the picture."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.scale = 10 ** rng.uniform(-2, 3)
        self.lamp = rng.normal(size=3) * self.scale * 10 ** rng.uniform(-1, 1.5)
        toward = rng.normal(size=3)
        self.distance = self.scale * 10 ** rng.uniform(0, 1)
        self.eye = self.lamp + toward / np.linalg.norm(toward) * self.distance
        self.extinction = 10 ** rng.uniform(-2.5, 0) / self.distance
        self.scattering = rng.uniform(0.3, 1) * self.extinction
        self.tangent = np.tan(np.radians(rng.uniform(10, 45)))
        back = self.eye - self.lamp - rng.normal(size=3) * self.distance
        right = np.cross(rng.normal(size=3), back)
        rows = [each / np.linalg.norm(each) for each in (right, np.cross(back, right), back)]
        self.to_world = np.eye(4)
        self.to_world[:3, :3], self.to_world[:3, 3] = np.transpose(rows), self.eye
        self.intensity = self.scale**2

    def expected(self):
        """Return the light that is scattered once: ∫ σs I / (4π r²) exp(−σt (t + r)) dt over t = b tan θ."""
        x, y = np.meshgrid(
            ((np.arange(WIDTH * SAMPLES) + 0.5) / (WIDTH * SAMPLES) * 2 - 1) * self.tangent,
            (1 - (np.arange(HEIGHT * SAMPLES) + 0.5) / (HEIGHT * SAMPLES) * 2) * self.tangent * HEIGHT / WIDTH,
        )
        direction = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ self.to_world[:3, :3].T
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        along = direction @ (self.lamp - self.eye)
        beside = np.sqrt(self.distance**2 - along**2)[:, None]
        nodes, weights = np.polynomial.legendre.leggauss(256)
        first = np.arctan2(-along[:, None], beside)
        angle = first + 0.5 * (np.pi / 2 - first) * (nodes + 1)
        path = along[:, None] + beside * np.tan(angle) + beside / np.cos(angle)
        values = np.exp(-self.extinction * path) * weights * 0.5 * (np.pi / 2 - first) / beside
        light = self.scattering * self.intensity / (4 * np.pi) * values.sum(axis=1)
        return light.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES).mean(axis=(1, 3))

    def by_mitsuba(self, speck):
        """Return the picture of a scene without shapes, or with a speck behind the camera."""
        film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}}
        parts = {
            "fog": {"type": "homogeneous", "id": "fog", "sigma_t": self.extinction,
                    "albedo": self.scattering / self.extinction},
            "lamp": {"type": "point", "position": [*self.lamp], "intensity": self.intensity, "medium": FOG},
            "sensor": {"type": "perspective", "fov": float(np.degrees(2 * np.arctan(self.tangent))), "medium": FOG,
                       "near_clip": 1e-4 * self.distance, "far_clip": 1e5 * self.distance, "film": film,
                       "to_world": T(self.to_world @ np.diag([-1, 1, -1, 1]))},
        }  # fmt: skip
        if speck:
            center = self.eye + self.to_world[:3, 2] * self.distance
            parts["speck"] = {"type": "sphere", "center": [*center], "radius": 1e-3 * self.distance, "exterior": FOG}
        integrator = mi.load_dict({"type": "photon_beams", "max_depth": 2, "method": "beams"})
        return np.array(mi.render(mi.load_dict({"type": "scene", **parts}), spp=32, integrator=integrator))[..., 1]

    def by_stage(self, usd):
        """Return the picture of a stage with a lamp and a camera."""
        fog = {"scattering": self.scattering, "absorption": self.extinction - self.scattering}
        coefficients = [f"color3f photonbeams:{name} = ({value}, {value}, {value})" for name, value in fog.items()]
        matrix = tuple(tuple(map(float, row)) for row in self.to_world.T)
        text = prim("Scope", "Fog", (0, 0, 0), *coefficients, api="PhotonBeamsMediumAPI")
        # A sphere light as a point has the intensity of a sphere of diameter 1, over π.
        text += prim(
            "SphereLight", "Lamp", tuple(map(float, self.lamp)), "bool treatAsPoint = 1", "float inputs:radius = 0",
            f"float inputs:intensity = {4 * self.intensity}",
        )  # fmt: skip
        text += f"""def Camera "Camera"
{{
    float horizontalAperture = {20 * self.tangent}
    float verticalAperture = {20 * self.tangent * HEIGHT / WIDTH}
    float focalLength = 10
    matrix4d xformOp:transform = {matrix}
    uniform token[] xformOpOrder = ["xformOp:transform"]
}}"""
        shot = pb.Shot.open(usd(text).GetRootLayer().realPath)
        found = shot.render(passes=8, width=WIDTH, height=HEIGHT, max_depth=2)
        return found.layers["beams"][..., 1].astype(float)


@pytest.mark.parametrize("seed", sweep(range(4), range(2)))
def test_endless_fog_has_all_of_its_light(seed, usd):
    """The median of all pixels is right within 1.5 %, and that of the outer columns within 4 %, which is their noise.

    Medians, because the mean over a pixel beside the lamp is not known well.
    """
    view = View(seed)
    expected = view.expected()
    for picture in (view.by_stage(usd), view.by_mitsuba(speck=seed % 2 == 0)):
        ratio = picture / expected
        assert np.median(ratio) == pytest.approx(1, abs=0.015)
        assert np.median(ratio[:, :2]) == pytest.approx(1, abs=0.04)
        assert np.median(ratio[:, -2:]) == pytest.approx(1, abs=0.04)


def test_light_from_infinity_in_endless_fog_is_met_by_walks_or_told(caplog):
    """With a speck that the camera is far from, `auto` has the light of `volpath`; beams alone give a warning."""
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
    scene = mi.load_dict({
        "type": "scene", "fog": {"type": "homogeneous", "id": "fog", "sigma_t": 0.1, "albedo": 0.8},
        "sun": {"type": "directional", "direction": [0, -1, 0], "irradiance": 3.0, "id": "sun"},
        "speck": {"type": "sphere", "radius": 0.3, "exterior": FOG},
        "sensor": {"type": "perspective", "fov": 30, "medium": FOG, "film": film,
                   "to_world": T().look_at([6, 0, 3], [0, 0, 3], [0, 1, 0])},
    })  # fmt: skip
    found = np.array(mi.render(scene, spp=256, integrator=mi.load_dict({"type": "photon_beams", "max_depth": 2})))
    theirs = reference("endless_fog/a sun and a speck", scene, 8192, max_depth=2)
    assert found.mean() == pytest.approx(theirs.mean(), rel=0.02)
    assert not caplog.records
    with caplog.at_level(logging.WARNING, logger="photonbeams"):
        mi.render(scene, spp=1, integrator=mi.load_dict({"type": "photon_beams", "max_depth": 2, "method": "beams"}))
    (record,) = caplog.records
    assert "the light of sun comes from infinity" in record.getMessage() and len(record.getMessage()) <= 300


def test_a_sky_brings_as_much_beside_a_lamp():
    """Light of a sky is dimmed over Mitsuba's distance to it, twice that of the place from the middle of the shapes.

    Directions that fog scatters never meet the sky, so samples of the sky count whole, whichever emitters there are.
    """
    extinction, albedo = 0.1, 0.8
    scene = mi.load_dict({
        "type": "scene", "fog": {"type": "homogeneous", "id": "fog", "sigma_t": extinction, "albedo": albedo},
        "sky": {"type": "constant", "radiance": 2.0}, "lamp": {"type": "point", "intensity": 1e-6, "medium": FOG},
        "speck": {"type": "sphere", "radius": 0.3, "exterior": FOG},
        "sensor": {"type": "perspective", "fov": 2, "medium": FOG,
                   "to_world": T().look_at([6, 0, 3], [0, 0, 3], [0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}},
    })  # fmt: skip
    integrator = mi.load_dict({"type": "photon_beams", "max_depth": 2, "method": "paths"})
    along = np.linspace(0, 200, 20001)
    dimmed = np.exp(-extinction * (along + 2 * np.hypot(6 - along, 3)))  # all of the ray is outside of the sphere
    expected = 2.0 * albedo * extinction * np.trapezoid(dimmed, along)
    assert np.mean(mi.render(scene, spp=32, integrator=integrator)) == pytest.approx(expected, rel=0.02)
