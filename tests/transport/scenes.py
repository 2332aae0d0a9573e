"""Small Mitsuba scenes for tests."""

import numpy as np

from photonbeams.device import mitsuba

mi = mitsuba()
T = mi.ScalarTransform4f


def rgb(value):
    return {"type": "rgb", "value": value}


def fog(extinction=0.5, albedo=0.9, **more):
    """Return a homogeneous medium."""
    peak = float(np.max(extinction))  # colours of media are reflectances to Mitsuba, 1 at most
    share = (np.asarray(extinction) / peak).tolist()
    return {"type": "homogeneous", "sigma_t": rgb(share), "scale": peak, "albedo": rgb(albedo), **more}


def cloud(color=(1.0,), resolution=8, seed=0, **more):
    """Return a medium on a grid over [−1, 1]³, whose density is noise that vanishes at the border."""
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
    """Return a cube without a surface of its own, filled with a medium."""
    return {"type": "cube", "to_world": T().scale(size), "bsdf": {"type": "null"}, "interior": medium}


def load(**parts):
    return mi.load_dict({"type": "scene", **parts})


def volpath(scene, passes, seed=0, plugin="volpath", **parameters):
    """Return Mitsuba's own picture, (H, W, 3)."""
    integrator = mi.load_dict({"type": plugin, "rr_depth": 50, **parameters})
    return np.array(mi.render(scene, integrator=integrator, spp=passes, seed=seed))[..., :3]
