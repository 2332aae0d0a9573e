"""Small Mitsuba scenes for tests."""

from dataclasses import replace

import numpy as np

from photonbeams.render.pilots.pilot import Findings
from photonbeams.render.scene_frame import Extras, render
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from tests.helpers.comparison import ABSORPTION, BOX, EYE, HOLE_X, HOLE_Y, HOLE_Z, SCATTERING, comparison_scene

mi = mitsuba()
T = mi.ScalarTransform4f


def by_beams(**given):
    """Return settings with which beams and photons carry all light."""
    return Settings(method="beams", **given)


def frames(scene, settings, seeds, extras=None):
    """Return a scene rendered with several seeds, which share the findings of one pilot."""
    known, result = Findings(), []
    for seed in range(seeds):
        own = replace(extras or Extras(), findings=known)
        result.append(render(scene, scene.sensors()[0], replace(settings, seed=seed), extras=own))
        known = result[-1].findings
    return result


def rgb(value):
    return {"type": "rgb", "value": value}


def fog(extinction=0.5, albedo=0.9, **more):
    """Return a homogeneous medium."""
    peak = float(np.max(extinction))  # Mitsuba treats colours of media as reflectances, at most 1
    share = (np.asarray(extinction) / peak).tolist()
    return {"type": "homogeneous", "sigma_t": rgb(share), "scale": peak, "albedo": rgb(albedo), **more}


def cloud(color=(1.0,), resolution=8, seed=0, **more):
    """Return a medium on a grid over [−1, 1]³, whose density is noise that vanishes at the boundary."""
    axes = np.linspace(-1, 1, resolution)
    place = np.stack(np.meshgrid(axes, axes, axes, indexing="ij"))
    noise = 0.5 + np.random.default_rng(seed).random((resolution,) * 3)
    density = noise * np.prod(1 - place**2, axis=0)
    grid = mi.VolumeGrid((density[..., None] * np.asarray(color)).astype(np.float32))
    volume = {"type": "gridvolume", "grid": grid, "raw": True, "to_world": T().translate(-1).scale(2)}
    return {"type": "heterogeneous", "sigma_t": volume, "albedo": 0.9, "scale": 1.5, **more}


def camera(origin=(0, 0.5, 4), target=(0, 0, 0), size=16, fov=40, medium=None, **film):
    return {
        "type": "perspective", "fov": fov, "near_clip": 1e-4, "to_world": T().look_at(origin, target, [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb",
                 "rfilter": {"type": "box"}, **film},
        **({} if medium is None else {"medium": medium}),
    }  # fmt: skip


def cube_of(medium, size=1.0):
    """Return a cube with a null BSDF, filled with a medium."""
    return {"type": "cube", "to_world": T().scale(size), "bsdf": {"type": "null"}, "interior": medium}


def load(optimize=True, **parts):
    return mi.load_dict({"type": "scene", **parts}, optimize=optimize)


def comparison(width=160, height=90):
    """Return the scene of tests/helpers/comparison.py in Mitsuba's terms."""
    low, high = BOX
    light, extinction = comparison_scene().lights[0], SCATTERING + ABSORPTION
    medium = mi.load_dict(fog(extinction, SCATTERING / extinction))
    black = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(0.0)}}

    def wall(y, z):
        place = T().translate([HOLE_X, sum(y) / 2, sum(z) / 2]).rotate([0, 1, 0], 90)
        return {"type": "rectangle", "to_world": place.scale([(z[1] - z[0]) / 2, (y[1] - y[0]) / 2, 1]), "bsdf": black}

    lamp = {
        "type": "rectangle", "bsdf": black, "emitter": {"type": "area", "radiance": rgb(light.radiance[0])},
        "to_world": T().translate(light.center).rotate([0, 1, 0], 90).scale(float(light.half_y[1])),
    }  # fmt: skip
    inside = T().translate((low + high) / 2).scale((high - low) / 2)
    seen = camera(EYE, (*EYE[:2], 0), fov=90, medium=medium)
    seen["film"].update(width=width, height=height)
    return load(
        box={"type": "cube", "to_world": inside, "bsdf": black, "interior": medium}, lamp=lamp, sensor=seen,
        below=wall((low[1], HOLE_Y[0]), (low[2], high[2])), above=wall((HOLE_Y[1], high[1]), (low[2], high[2])),
        left=wall(HOLE_Y, (low[2], HOLE_Z[0])), right=wall(HOLE_Y, (HOLE_Z[1], high[2])),
    )  # fmt: skip


def volpath(scene, passes, seed=0, plugin="volpath", **parameters):
    """Return Mitsuba's own picture, (H, W, 3)."""
    integrator = mi.load_dict({"type": plugin, "rr_depth": 50, **parameters})
    return np.array(mi.render(scene, integrator=integrator, spp=passes, seed=seed))[..., :3]


TILT = 0.2


def tilted(nested):
    """Return a BSDF whose normal leans toward −x, away from the wall."""
    normal = 0.5 + 0.5 * np.array([-np.sin(TILT), 0, np.cos(TILT)], dtype=np.float32)
    image = {"type": "bitmap", "data": mi.TensorXf(np.tile(normal, (4, 4, 1))), "raw": True}
    return {"type": "normalmap", "normalmap": image, "nested": nested}


def bumpy(nested):
    """Return a BSDF with a slope that rises toward the wall, and drops where the image repeats."""
    height = np.tile(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], (4, 1, 1))
    image = {"type": "bitmap", "data": mi.TensorXf(height), "raw": True}
    return {"type": "bumpmap", "height": image, "scale": 2 * TILT, "nested": nested}
