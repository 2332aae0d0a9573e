"""A closed Mitsuba room full of fog, with a window and lamps before it."""

from tests.helpers.mitsuba_scenes import T, camera, fog, load, rgb

LAMPS = {
    "area": {"type": "rectangle", "to_world": T().look_at([-6, 4, -1], [-2, 1.6, -0.5], [0, 1, 0]).scale(0.5),
             "emitter": {"type": "area", "radiance": rgb(200.0)}},
    "point": {"type": "point", "position": [-3, 2.5, -0.8], "intensity": rgb(50.0)},
    "sun": {"type": "directional", "direction": [1, -0.6, 0.2], "irradiance": rgb(20.0)},
    "sky": {"type": "constant", "radiance": rgb(1.0)},
}  # fmt: skip


def room(*lamps, size=(32, 18)):
    """Return a closed room of grey walls, with a window at x = −2, full of fog that the walls do not name."""
    grey = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(0.5)}}

    def across(axis, center, width, height):
        turn = {"x": ([0, 1, 0], 90), "y": ([1, 0, 0], 90), "z": ([0, 1, 0], 0)}[axis]
        place = T().translate(center).rotate(*turn).scale([width / 2, height / 2, 1])
        return {"type": "rectangle", "to_world": place, "bsdf": grey}

    medium = fog(0.15)
    sensor = camera([1.6, 1.5, 1.9], [-1.5, 1.2, -0.6], fov=70, medium=medium)
    sensor["film"].update(width=size[0], height=size[1])
    return load(
        below=across("x", [-2, 0.6, 0], 4, 1.2), above=across("x", [-2, 2.5, 0], 4, 1),
        left=across("x", [-2, 1.6, -1.4], 1.2, 0.8), right=across("x", [-2, 1.6, 0.85], 2.3, 0.8),
        other=across("x", [2, 1.5, 0], 4, 3), back=across("z", [0, 1.5, -2], 4, 3),
        front=across("z", [0, 1.5, 2], 4, 3), floor=across("y", [0, 0, 0], 4, 4), ceiling=across("y", [0, 3, 0], 4, 4),
        fog={"type": "cube", "bsdf": {"type": "null"}, "interior": medium,
             "to_world": T().translate([0, 1.5, 0]).scale([1.99, 1.49, 1.99])},
        sensor=sensor, **{name: LAMPS[name] for name in lamps},
    )  # fmt: skip
