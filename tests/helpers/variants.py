"""Grey Mitsuba scenes, which are the same picture in every variant, and processes that render them.

`python -m tests.helpers.variants VARIANT` reads cases, a line of JSON each, and writes their pictures, a line each.
"""

import json
import os
import subprocess
import sys
from itertools import product

import numpy as np

from photonbeams.render.settings import METHODS

EMITTERS = (
    "point", "spot", "textured spot", "projector", "directional", "directionalarea", "area", "textured area", "sphere",
    "constant", "envmap",
)  # fmt: skip
#: A kind of emitter, a method, and whether there are surfaces.
CASES = list(product(EMITTERS, METHODS, (True, False)))
NAMES = [f"{emitter}, {method}, {'with' if surfaces else 'without'} surfaces" for emitter, method, surfaces in CASES]

_SIZE = 12


class Variant:
    """A process whose Mitsuba has a variant, because a process has one device."""

    def __init__(self, name):
        path = os.pathsep.join(each for each in sys.path if each)
        self._process = subprocess.Popen(
            [sys.executable, "-m", __spec__.name, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": path, "PHOTONBEAMS_DEVICE": "auto"},
        )  # fmt: skip

    def picture(self, case):
        """Return the picture of a case, (H, W)."""
        self._process.stdin.write(f"{json.dumps(case)}\n")
        self._process.stdin.flush()
        return np.array(json.loads(self._process.stdout.readline()))

    def close(self):
        self._process.communicate()


def _emitters(mi):
    """Return the emitters by their kinds."""
    down = mi.ScalarTransform4f().look_at([0, 2, 0], [0, 0, 1], [1, 0, 0])
    ramp = mi.Bitmap(np.linspace(0.2, 1, 64, dtype=np.float32).reshape(8, 8, 1).repeat(3, axis=2))
    image = {"type": "bitmap", "bitmap": ramp, "raw": True}
    fog = {"medium": {"type": "ref", "id": "fog"}}

    def panel(kind, radiance):
        emitter = {"type": kind, "radiance": radiance}
        return {"type": "rectangle", "to_world": down @ mi.ScalarTransform4f().scale(0.3), "emitter": emitter}

    return {
        "point": {"type": "point", "position": [0.5, 1, 0], "intensity": 5.0, **fog},
        "spot": {"type": "spot", "to_world": down, "intensity": 5.0, **fog},
        "textured spot": {"type": "spot", "to_world": down, "intensity": 5.0, "texture": image, **fog},
        "directional": {"type": "directional", "direction": [0, -1, 1], "irradiance": 1.0},
        "directionalarea": panel("directionalarea", 9.0),
        "area": panel("area", 9.0),
        "textured area": panel("area", image),
        "sphere": {"type": "sphere", "radius": 0.3, "emitter": {"type": "area", "radiance": 9.0}},
        "projector": {"type": "projector", "to_world": down, "irradiance": image, "fov": 40.0, "scale": 5.0, **fog},
        "constant": {"type": "constant", "radiance": 0.2},
        "envmap": {"type": "envmap", "bitmap": ramp},
    }


def _scene(mi, emitter, method, surfaces):
    """Return a box of fog with the emitter, and with surfaces of three kinds."""
    place = mi.ScalarTransform4f()
    seen = {
        "floor": {"type": "rectangle", "to_world": place.look_at([0, -1, 3], [0, 0, 0], [0, 1, 0]).scale(5)},
        "glass": {"type": "sphere", "center": [-1, 0, 0], "radius": 0.5, "bsdf": {"type": "dielectric"}},
        "metal": {"type": "sphere", "center": [1, 0, 0], "radius": 0.5, "bsdf": {"type": "roughconductor"}},
    }
    parts = {
        "type": "scene",
        "fog": {"type": "homogeneous", "albedo": 0.9, "sigma_t": 0.3},
        "box": {
            "type": "cube", "to_world": place.scale(6), "bsdf": {"type": "null"},
            "interior": {"type": "ref", "id": "fog"},
        },
        "sensor": {
            "type": "perspective", "fov": 60, "to_world": place.look_at([0, 0, -4], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "pixel_format": "luminance", "width": _SIZE, "height": _SIZE},
        },
        "integrator": {"type": "photon_beams", "method": method, "paths": 512},
        "emitter": _emitters(mi)[emitter],
        **(seen if surfaces else {}),
    }  # fmt: skip
    # Mitsuba's threads make shapes and emitters in any order, and random numbers choose between them.
    return mi.load_dict(parts, parallel=False)


def _render(variant):
    """Write the pictures of the cases that are asked for."""
    import mitsuba as mi

    mi.set_variant(variant)
    for line in sys.stdin:
        picture = np.array(mi.render(_scene(mi, *json.loads(line)), seed=1, spp=2))
        print(json.dumps(picture[..., 0].tolist()), flush=True)


if __name__ == "__main__":
    _render(sys.argv[1])
