"""Random Mitsuba scenes that no artist would build, to test what must hold for every scene."""

import numpy as np

from tests.helpers.mitsuba_scenes import T, cloud, cube_of, fog, mi, rgb

# Reconstruction filters; the last three have negative lobes.
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")
LOBES = FILTERS[3:]
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
SCALES = (1.0, 1.0, 1.0, 1.0, 1e-4, 1e-2, 1e2, 1e4)
FORMATS = ("luminance", "luminance_alpha", "rgb", "rgba", "xyz", "xyza")


class Maker:
    """Makes random parts of scenes; `size` is the scale of all of them."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.size = float(self.rng.choice(SCALES))

    def one(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def chance(self, share):
        return self.rng.random() < share

    def color(self, most=1.0):
        return rgb(self.one(0.0, most, most, (most * self.rng.random(3)).tolist(), [most, 0.0, 0.0]))

    def point(self, reach=2.0):
        return (self.size * self.rng.uniform(-reach, reach, 3)).tolist()

    def look_at(self):
        return T().look_at(self.point(4), self.point(0.3), [0.1, 1, 0.2])

    def place(self, reach=1.5):
        scale = self.size * self.rng.uniform(0.05, 0.6, 3) * self.one(1, 1, 1, [1, 1, 1e-3], [1, 1, -1])
        turn = T().rotate(self.rng.normal(size=3).tolist(), self.rng.uniform(0, 360))
        return T().translate(self.point(reach)) @ turn @ T().scale(scale.tolist())

    # -- surfaces ----------------------------------------------------------------------------------------------------

    def bsdf(self, depth=0):
        kinds = [
            self._diffuse, self._twosided, self._smooth_metal, self._rough_metal, self._glass, self._plastic,
            self._null, self._principled, self._thin, self._hair,
        ]  # fmt: skip
        if depth < 1:
            kinds += [self._mask, self._blend, self._bumpy]
        return self.one(*kinds)(depth)

    def _diffuse(self, _):
        return {"type": "diffuse", "reflectance": self.color()}

    def _twosided(self, _):
        return {"type": "twosided", "side": self._diffuse(0)}

    def _smooth_metal(self, _):
        return {"type": "conductor", "material": self.one("none", "Au")}

    def _rough_metal(self, _):
        return {"type": "roughconductor", "alpha": self.one(0.0001, 0.1, 0.9), "material": "Al",
                "distribution": self.one("beckmann", "ggx")}  # fmt: skip

    def _glass(self, _):
        kind = self.one("dielectric", "thindielectric", "roughdielectric")
        more = {"alpha": self.one(0.001, 0.2)} if kind == "roughdielectric" else {}
        return {"type": kind, "int_ior": self.one(1.0 + 1e-3, 1.33, 1.5, 2.4), "ext_ior": self.one(1.0, 1.3), **more}

    def _plastic(self, _):
        return {"type": self.one("plastic", "roughplastic"), "diffuse_reflectance": self.color()}

    def _null(self, _):
        return {"type": "null"}

    def _principled(self, _):
        return {"type": "principled", "base_color": self.color(), "roughness": self.one(0.01, 0.5),
                "metallic": self.one(0.0, 1.0), "spec_trans": self.one(0.0, 0.7)}  # fmt: skip

    def _thin(self, _):
        return {"type": "principledthin", "base_color": self.color(), "roughness": self.one(0.01, 0.5),
                "diff_trans": self.one(0.0, 1.5), "spec_trans": self.one(0.0, 0.7)}  # fmt: skip

    def _hair(self, _):
        return {"type": "hair", "eumelanin": 0.2, "pheomelanin": 0.4}

    def _mask(self, depth):
        return {"type": "mask", "opacity": self.one(0.0, 0.5, 1.0), "nested": self.bsdf(depth + 1)}

    def _blend(self, depth):
        return {"type": "blendbsdf", "weight": self.rng.random(), "a": self.bsdf(depth + 1), "b": self._diffuse(0)}

    def _bumpy(self, _):
        noise = self.rng.random((4, 4, 3)).astype(np.float32)
        if self.chance(0.5):
            noise[..., 2] += 1
            texture = {"type": "bitmap", "bitmap": mi.Bitmap(noise), "raw": True}
            return {"type": "normalmap", "normalmap": texture, "nested": self._diffuse(0)}
        texture = {"type": "bitmap", "bitmap": mi.Bitmap(noise[..., :1]), "raw": True}
        return {"type": "bumpmap", "height": texture, "scale": self.one(0.1, 10.0), "nested": self._plastic(0)}

    # -- media -------------------------------------------------------------------------------------------------------

    def medium(self):
        phase = {} if self.chance(0.3) else {"phase": self.phase()}
        if self.chance(0.3):
            return self._grid(phase)
        density = self.one(0.0, 1e-3, 0.5, 5.0, 1e4, 1e12) / self.size
        if density == 0:
            return {"type": "homogeneous", "sigma_t": 0.0, "albedo": 0.5, **phase}
        tint = self.one([1.0] * 3, [1.0] * 3, [0.2, 0.6, 1.0], [0.0, 0.5, 1.0])
        albedo = self.one(0.0, 0.5, 1.0, [1.0, 0.5, 0.0])
        return fog([density * each for each in tint], albedo, **phase)

    def _grid(self, phase):
        medium = cloud(self.one((1.0,), (1.0, 0.4, 0.0)), resolution=int(self.one(2, 5)), **phase)
        medium["sigma_t"]["to_world"] = T().scale(self.size) @ medium["sigma_t"]["to_world"]
        medium["scale"] = self.one(0.0, 0.5, 30.0) / self.size
        medium["albedo"] = self.one(0.0, 0.8, 1.0)
        return medium

    def phase(self, depth=0):
        kinds = [
            {"type": "isotropic"}, {"type": "rayleigh"},
            {"type": "hg", "g": self.one(0.0, -0.5, 0.9, 0.98, 0.999, -0.999)},
            {"type": "tabphase", "values": self.one("0,0,1", "1,1", "0.1,0.2,5")},
        ]  # fmt: skip
        if depth == 0:
            kinds.append({"type": "blendphase", "weight": self.rng.random(), "a": self.phase(1), "b": self.phase(1)})
        return self.one(*kinds)

    # -- shapes ------------------------------------------------------------------------------------------------------

    def shape(self):
        kind = self.one("sphere", "rectangle", "cube", "disk", "cylinder", "sdfgrid")
        shape = {"type": kind}
        if kind == "sphere":
            shape.update(
                center=self.point(1.5),
                radius=self.size * float(self.rng.choice([1e-6, 0.1, 0.5, 5.0], p=[0.1, 0.5, 0.35, 0.05])),
            )
        elif kind == "cylinder":
            shape.update(p0=self.point(), p1=self.point(), radius=self.size * 0.2)
        else:
            shape["to_world"] = self.place()
        if kind == "sdfgrid":
            shape["grid"] = mi.TensorXf(self.rng.normal(size=(4, 4, 4, 1)).astype(np.float32))
        elif kind in ("sphere", "cylinder", "disk", "rectangle") and self.chance(0.2):
            shape["flip_normals"] = True
        return shape

    def solid(self):
        return {**self.shape(), "bsdf": self.bsdf()}

    def foggy(self):
        """Return shapes with a medium inside, which may have any BSDF and be nested, and the medium."""
        medium = mi.load_dict(self.medium())
        outer = {**cube_of(medium, self.size * self.one(0.8, 3.0))}
        if self.chance(0.3):
            outer["bsdf"] = self.bsdf()
        parts = {"fog": outer}
        if self.chance(0.3):
            inner = {"type": "sphere", "center": self.point(0.3), "radius": self.size * 0.4}
            inner["bsdf"] = self.one({"type": "null"}, {"type": "dielectric"}, self.bsdf())
            parts["inner"] = {**inner, "interior": mi.load_dict(self.medium()), "exterior": medium}
        if self.chance(0.4):
            parts |= self.one(self._overlapping, self._sheet, self._copies, self._wall)(medium)
        return parts, medium

    def _overlapping(self, medium):
        """Return a shape that contains the same medium or another one, and may stand anywhere."""
        own = self.one(medium, mi.load_dict(self.medium()))
        bsdf = self.one({"type": "null"}, {"type": "dielectric"})
        return {"other": {**self.shape(), "bsdf": bsdf, "interior": own}}

    def _sheet(self, medium):
        """Return a surface without thickness that names media."""
        named = {side: medium for side in ("interior", "exterior") if self.chance(0.6)}
        bsdf = self.one({"type": "null"}, self.bsdf())
        return {"sheet": {"type": "rectangle", "to_world": self.place(), "bsdf": bsdf, **named}}

    def _wall(self, medium):
        """Return a wall that lies on the boundary of the fog, very close to it, or elsewhere."""
        turn = T().translate([0, -self.size * self.one(0.8, 0.8 + 1e-6, 3.0), 0]).rotate([1, 0, 0], -90)
        wall = {"type": "rectangle", "to_world": turn.scale(self.size * 3), "bsdf": self.bsdf()}
        return {"wall": {**wall, **({"exterior": medium} if self.chance(0.4) else {})}}

    def _copies(self, medium):
        """Return shapes with a medium inside, in a shape group or merged."""
        part = {"type": "cube", "to_world": self.place(), "bsdf": {"type": "null"}, "interior": medium}
        if self.chance(0.3):
            return {"merged": {"type": "merge", "one": part, "two": {**part, "to_world": self.place()}}}
        group = {"type": "ref", "id": "group"}
        return {
            "group": {"type": "shapegroup", "part": part},
            "copy": {"type": "instance", "to_world": T().translate(self.point(0.5)), "group": group},
        }

    # -- lights ------------------------------------------------------------------------------------------------------

    def light(self, medium=None):
        kind = self.one("point", "spot", "area", "area", "mesh", "constant", "envmap", "directional", "projector",
                        "directionalarea", "sunsky")  # fmt: skip
        said = {} if medium is None or self.chance(0.7) else {"medium": medium}
        power = self.color(self.one(1.0, 1e6))
        if kind in ("area", "mesh", "directionalarea"):
            shape = {"type": "cube", "to_world": self.place()} if kind == "mesh" else self.shape()
            if kind == "directionalarea":
                shape = {"type": "rectangle", "to_world": self.place()}
            bsdf = {"bsdf": self.bsdf()} if self.chance(0.5) else {}
            if medium is not None and self.chance(0.3):
                bsdf[self.one("interior", "exterior")] = medium
            return {**shape, **bsdf, "emitter": {"type": kind.replace("mesh", "area"), "radiance": power}}
        if kind == "point":
            return {"type": kind, "position": self.point(), "intensity": power, **said}
        if kind == "spot":
            return {"type": kind, "to_world": self.look_at(), "intensity": power,
                    "cutoff_angle": self.one(0.1, 20.0, 90.0), "beam_width": 0.05, **said}  # fmt: skip
        if kind == "sunsky":
            return {"type": kind, "turbidity": self.one(1.0, 5.0, 10.0), "sun_scale": self.one(0.0, 1.0)}
        if kind == "constant":
            return {"type": kind, "radiance": power}
        image = mi.Bitmap(self.rng.random((4, 8, 3)).astype(np.float32) * self.one(0.0, 1.0))
        if kind == "envmap":
            return {"type": kind, "bitmap": image}
        if kind == "directional":
            return {"type": kind, "direction": self.rng.normal(size=3).tolist(), "irradiance": power}
        return {"type": kind, "to_world": self.look_at(), "irradiance": {"type": "bitmap", "bitmap": image}, "fov": 40}

    # -- sensors -----------------------------------------------------------------------------------------------------

    def sensor(self, medium=None):
        kind = self.one("perspective", "perspective", "perspective", "thinlens", "orthographic", "radiancemeter",
                        "distant", "irradiancemeter")  # fmt: skip
        many = kind in ("perspective", "thinlens", "orthographic")
        film = self.film(8 if many else 1)
        sampler = {"type": self.one(*SAMPLERS), "sample_count": self.one(1, 4)}
        sensor = {"type": kind, "film": film, "sampler": sampler}
        if medium is not None and self.chance(0.3):
            sensor["medium"] = medium
        if many:
            inside = self.chance(0.3)
            sensor["to_world"] = T().look_at(self.point(0.2 if inside else 5), self.point(0.1), [0, 1, 0.1])
            sensor["near_clip"], sensor["far_clip"] = 1e-3 * self.size, 1e3 * self.size
        if kind in ("perspective", "thinlens"):
            sensor["fov"] = self.one(1.0, 45.0, 150.0)
        if kind == "thinlens":
            sensor.update(aperture_radius=self.size * self.one(0.0001, 0.3), focus_distance=self.size * 3)
        if kind == "orthographic":
            sensor["to_world"] = sensor["to_world"] @ T().scale([self.size, self.size, 1])
        if kind == "radiancemeter":
            sensor.update(origin=self.point(), direction=self.rng.normal(size=3).tolist())
        if kind == "distant":
            sensor.update(direction=self.rng.normal(size=3).tolist())
        if kind == "irradiancemeter":
            return {"type": "rectangle", "to_world": self.place(), "sensor": sensor}
        return sensor

    def film(self, size):
        film = {"type": "hdrfilm", "width": size, "height": size, "pixel_format": self.one(*FORMATS),
                "rfilter": {"type": self.one(*FILTERS)}}  # fmt: skip
        if size > 1 and self.chance(0.2):
            film.update(crop_offset_x=3, crop_offset_y=1, crop_width=4, crop_height=5)
        return film

    # -- scenes ------------------------------------------------------------------------------------------------------

    def scene(self):
        parts, medium = self.foggy() if self.chance(0.75) else ({}, None)
        if self.chance(0.1):
            medium = mi.load_dict(self.medium())
        for index in range(self.rng.integers(0, 3)):
            parts[f"solid{index}"] = self.solid()
        if self.chance(0.1) and "solid0" in parts:
            parts["twin"] = parts["solid0"]
        for index in range(self.rng.integers(1, 3) if self.chance(0.9) else 0):
            parts[f"light{index}"] = self.light(medium)
        skies = [name for name, part in parts.items() if part["type"] in ("constant", "envmap", "sunsky")]
        for name in skies[1:]:  # Mitsuba accepts only one
            del parts[name]
        return {"type": "scene", **parts, "sensor": self.sensor(medium)}

    def integrator(self):
        depth = int(self.rng.choice([-1, 0, 1, 2, 3], p=[0.6, 0.05, 0.05, 0.15, 0.15]))
        settings = {
            "type": "photon_beams", "paths": int(self.one(1, 200, 200)), "max_depth": depth,
            "rr_depth": int(self.one(1, 5)), "beams": self.one("long", "short"), "hide_emitters": self.chance(0.3),
            "layers": self.chance(0.2), "estimator": self.one("auto", "auto", "billboard", "frustum"),
            "guiding": self.chance(0.2), "method": self.one("beams", "beams", "paths"),
        }  # fmt: skip
        if self.chance(0.2):
            settings["radius"] = self.size * self.one(1e-3, 0.5)
        return settings
