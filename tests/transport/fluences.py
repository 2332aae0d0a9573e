"""The fluence of single lamps: by integration over the lamp, and as beams estimate it."""

import numpy as np

from photonbeams import scene


def unit(rng):
    """Return a random direction."""
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def cloud(rng, count, whole):
    """Return the points of a surface's elements, their normals and areas, for a lamp of size `whole`: see `fluence`."""
    u, v = rng.random((2, count))
    return 2 * u - 1, 2 * v - 1, np.full(count, whole / count)


def fluence(points, at, normals, areas, radiance):
    """Return the fluence at points, ∫ L max(cos θ, 0) dA / d², over the elements of a lamp."""
    to = points[:, None] - at
    squared = (to**2).sum(axis=2)
    cosine = np.einsum("ijk,jk->ij", to, normals) / np.sqrt(squared)
    return (radiance * np.maximum(cosine, 0) / squared * areas).sum(axis=1)


def lamp(kind, center, size, rng, target):
    """Return a lamp of a kind, of radiance 1, which faces the target roughly, and a function: its fluence at points."""
    along = target - center
    along /= np.linalg.norm(along)
    along = along + 0.3 * unit(rng)
    along /= np.linalg.norm(along)
    x = np.cross(along, unit(rng))
    x /= np.linalg.norm(x)
    y = np.cross(along, x)
    a, b, areas = cloud(rng, 4096, 1)
    if kind == "point":
        return scene.SphereLight("/l", 1.0, center=center), lambda p: 1 / ((p - center) ** 2).sum(axis=1)
    if kind == "sphere":
        return scene.SphereLight(
            "/l", 1.0, center=center, radius=size
        ), lambda p: 2 * np.pi * (1 - np.sqrt(1 - size**2 / ((p - center) ** 2).sum(axis=1)))
    if kind == "cylinder":
        light = scene.CylinderLight("/l", 1.0, center=center, half=size * x, radius=0.2 * size)
        normals = np.cos(np.pi * b)[:, None] * y + np.sin(np.pi * b)[:, None] * along
        at = center + size * a[:, None] * x + 0.2 * size * normals
        return light, lambda p: fluence(p, at, normals, light.area * areas, 1)
    if kind in ("rectangle", "disk"):
        light = scene.FlatLight(
            "/l", 1.0, center=center, half_x=size * x, half_y=size * y, axis=along, disk=kind == "disk"
        )
        there = np.hypot(a, b) < 1 if light.disk else np.full(len(a), True)
        at = center + size * (a[:, None] * x + b[:, None] * y)[there]
        return light, lambda p: fluence(p, at, np.tile(along, (len(at), 1)), light.area / len(at), 1)
    angle = float(kind)
    solid = 2 * np.pi * (1 - np.cos(np.radians(angle / 2)))
    return scene.DistantLight("/l", 1.0, axis=along, angle=angle), lambda p: np.full(len(p), solid)


def estimated(sets, points):
    """Return the fluence that beams estimate at points, with Epanechnikov's kernel across them."""
    result = np.zeros(len(points))
    for each in sets:
        beams = each.beams
        start, end = (np.array(side, dtype=np.float64).T for side in (beams.start, beams.end))
        first, last = (np.array(side, dtype=np.float64) for side in (beams.radius_start, beams.radius_end))
        power, length = np.array(beams.power, dtype=np.float64)[0], np.linalg.norm(end - start, axis=1)
        axis = (end - start) / length[:, None]
        for number, point in enumerate(points):
            to = point - start
            s = (to * axis).sum(axis=1)
            radius = first + (last - first) * s / length
            squared = (to**2).sum(axis=1) - s**2
            there = (s > 0) & (s < length) & (squared < radius**2)
            result[number] += (2 / np.pi * power * (1 - squared / radius**2) / radius**2)[there].sum()
    return result
