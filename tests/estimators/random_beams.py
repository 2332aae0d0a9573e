"""Random beams and rays, looks with their float64 twins, and the difference between an estimate and its twin."""

import drjit as dr
import numpy as np

import photonbeams as pb
from photonbeams.estimators import estimate
from photonbeams.runtime.device import Array3f
from tests.helpers import beam_twin as twin
from tests.helpers.beam_twin import Beam, TwinLook

EPSILON32 = float(np.finfo(np.float32).eps)
CONVERGED = pb.gauss_legendre(64)
MEDIUM = pb.Medium((0.3, 0.2, 0.1), (0.05, 0.1, 0.2), 0.3)
EXTINCTION = np.array(MEDIUM.extinction)
RAMP = ([0.0, 0.4, 1.0], [[1.0, 0.9, 0.6], [0.9, 0.3, 0.1], [0.1, 0.1, 0.4]])


def attenuation(_, depth, *__):
    return np.exp(-EXTINCTION * np.asarray(depth)[..., None])


def phase(cosine, g=MEDIUM.anisotropy):
    value = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    return np.array(MEDIUM.scattering) * value[..., None]


def ramp(_, depth, fraction):
    colour = np.stack([np.interp(fraction, RAMP[0], channel) for channel in np.transpose(RAMP[1])], axis=-1)
    return colour * attenuation(_, depth)


def smoothstep(rho):
    # ∫ (1 − 3ρ² + 2ρ³) 2πρ dρ = 3π/10
    return (1 - rho * rho * (3 - 2 * rho)) * 10 / (3 * np.pi)


PHYSICAL = {"along": attenuation, "eye": attenuation, "angle": phase}
LOOKS = {
    "physical": (pb.Look(), TwinLook(lambda rho: 2 / np.pi * (1 - rho * rho), **PHYSICAL)),
    "uniform": (
        pb.Look(across=pb.looks.Uniform(), along=1.0, eye=1.0, angle=1.0),
        TwinLook(lambda rho: np.full_like(rho, 1 / np.pi)),
    ),
    "ramp": (
        pb.Look(along=pb.looks.ColorRamp(*RAMP) * pb.looks.Attenuation(), across=pb.looks.Smoothstep()),
        TwinLook(smoothstep, ramp, attenuation, phase, corners=(0.4,)),
    ),
    "place, radius and view": (
        pb.Look(
            along=lambda s, P: 0.6 + 0.4 * s * dr.sin(2 * P.x - P.y),
            across=pb.looks.Biweight()
            * pb.looks.Function(lambda r, distance: Array3f(1, 1 - 0.5 * r * r, 1 / (1 + distance * r * r))),
            eye=lambda t, P: dr.exp(-0.3 * t) * (1.5 + dr.cos(P.z)),
            angle=lambda cosine, s: 1 + 0.5 * cosine * s,
        ),
        TwinLook(lambda rho: 3 / np.pi * (1 - rho * rho) ** 2, more=lambda **at: artful(**at)),
    ),
}


def artful(s, distance, r, t, P, cosine):
    """Return the product of the factors of the last of these looks, (…, 3)."""
    along = 0.6 + 0.4 * s * np.sin(2 * P[..., 0] - P[..., 1])
    eye = np.exp(-0.3 * t) * (1.5 + np.cos(P[..., 2]))
    angle = 1 + 0.5 * cosine * s
    colours = np.stack(np.broadcast_arrays(1 + 0 * r, 1 - 0.5 * r * r, 1 / (1 + distance * r * r)), axis=-1)
    return (along * eye * angle)[..., None] * colours


def beams_of(*beams):
    fields = [beam.fields() for beam in beams]
    return pb.Beams(**{name: np.array([field[name] for field in fields]) for name in fields[0]})


def radiance(beams, origin, direction, look, estimator, **given):
    beams = beams_of(beams) if isinstance(beams, Beam) else beams
    given.setdefault("medium", MEDIUM)
    given.setdefault("rule", CONVERGED)
    t_max = given.pop("t_max", None)
    value = estimate(beams, origin, direction, t_max, look=look, estimator=estimator, **given)
    return np.asarray(value, dtype=np.float64)


def as_float32(values):
    """Return numbers rounded to float32, so that a twin and the kernel have the same input."""
    return np.asarray(values, dtype=np.float32).astype(np.float64)


def random_beam(rng, **given):
    """Return a cone with a random taper; about one in six is pointed."""
    start, end = as_float32(rng.uniform(-1, 1, (2, 3)))
    radii = as_float32(rng.uniform(0.02, 0.3, 2) * (rng.uniform(size=2) > 1 / 12))
    if not radii.any():
        radii[0] = 0.125
    return Beam(start, end, *radii.tolist(), power=(1.0, 0.5, 2.0), **given)


def random_rays(rng, beam, count=400):
    """Return origins and unit directions of rays past and through a beam, a quarter of them from inside it."""
    f = rng.uniform(-0.1, 1.1, (count, 1))
    radius = np.abs(beam.radius(f * beam.length)) + 0.01
    target = beam.start + f * (beam.end - beam.start) + rng.normal(size=(count, 3)) * radius / 2
    origin = rng.uniform(-2, 2, (count, 3))
    origin[: count // 4] = target[: count // 4] + rng.normal(size=(count // 4, 3)) * radius[: count // 4] / 4
    target[: count // 4] += rng.normal(size=(count // 4, 3))
    direction = target - origin
    return as_float32(origin), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def smooth_part(beam, look, origin, direction, t_min, t_max, reference, distance):
    """Return how much the twin changes when the ray is moved by `distance`: the error that rounding may cause.

    The estimates have steps (an end, a surface) and infinite slopes (the rim of a profile). There the result in float32
    may be that of the twin for a ray that is a rounding error away.
    """
    change = np.zeros_like(reference)
    for shift in distance * np.concatenate([np.eye(3), -np.eye(3)]):
        change = np.maximum(
            change, np.abs(twin.billboard(beam, look, origin + shift, direction, t_min, t_max) - reference)
        )
    return change


def beside_the_twin(beam, name, estimator, rng):
    """Return the radiance of a beam along random rays, that of the twin, and the rounding error of a billboard."""
    look, double = LOOKS[name]
    origin, direction = random_rays(rng, beam)
    # For rays closer to the axis' direction the billboard is singular, and `auto` does not use it.
    keep = (np.linalg.norm(np.cross(direction, beam.axis), axis=1) > 0.1) | (estimator == "frustum")
    origin, direction = origin[keep], direction[keep]
    expected = getattr(twin, estimator)(beam, double, origin, direction)
    found = radiance(beam, origin, direction, look, estimator)
    places = 0.0
    if estimator == "billboard":
        places = 2 * smooth_part(beam, double, origin, direction, 0, twin.ENDLESS, expected, 4 * EPSILON32 / 0.01)
    return found, expected, places


def pixel_directions(forward, width, height, field=1.6):
    """Return unit directions of a pinhole picture's pixels, `field` wide at distance 1."""
    forward = np.asarray(forward, dtype=float) / np.linalg.norm(forward)
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x, y = np.meshgrid((np.arange(width) + 0.5) / width - 0.5, 0.5 - (np.arange(height) + 0.5) / height)
    direction = forward + field * (x[..., None] * right + height / width * y[..., None] * up)
    direction = direction.reshape(-1, 3)
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
