"""The estimators toward any rays, against float64 twins, closed forms, and each other."""

import numpy as np
import pytest

import photonbeams as pb
from estimators import twin
from estimators.twin import Beam, TwinLook
from photonbeams.device import Array3f
from photonbeams.estimators import estimate

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
        pb.Look(across=pb.Uniform(), along=1.0, eye=1.0, angle=1.0),
        TwinLook(lambda rho: np.full_like(rho, 1 / np.pi)),
    ),
    "ramp": (
        pb.Look(along=pb.ColorRamp(*RAMP) * pb.Attenuation(), across=pb.Smoothstep()),
        TwinLook(smoothstep, ramp, attenuation, phase, corners=(0.4,)),
    ),
}


def beams_of(*beams):
    fields = [beam.fields() for beam in beams]
    return pb.Beams(**{name: np.array([field[name] for field in fields]) for name in fields[0]})


def radiance(beams, origin, direction, look, estimator, **given):
    beams = beams_of(beams) if isinstance(beams, Beam) else beams
    given.setdefault("medium", MEDIUM)
    given.setdefault("rule", CONVERGED)
    t_max = given.pop("t_max", None)
    value = estimate(beams, origin, direction, t_max, look=look, estimator=estimator, **given)
    return np.asarray(value, dtype=np.float64).T


def as_float32(values):
    """Return numbers that float32 holds, so that a twin sees what the kernel sees."""
    return np.asarray(values, dtype=np.float32).astype(np.float64)


def random_beam(rng, **given):
    """Return a cone of any taper, every sixth of them pointed."""
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
    """Return how much the twin changes where the ray is moved by `distance`: what rounding may cost.

    The estimates have steps (an end, a surface) and endless slopes (the rim of a profile). There float32 may answer
    what the twin answers a rounding error farther on.
    """
    change = np.zeros_like(reference)
    for shift in distance * np.concatenate([np.eye(3), -np.eye(3)]):
        change = np.maximum(change, np.abs(twin.billboard(beam, look, origin + shift, direction, t_min, t_max) - reference))
    return change


@pytest.mark.parametrize("name", LOOKS)
def test_billboard_equals_its_twin_on_random_beams_and_rays(name, rng):
    look, double = LOOKS[name]
    for _ in range(12):
        beam = random_beam(rng)
        origin, direction = random_rays(rng, beam)
        # Nearer to the axis the billboard is singular, and `auto` does not use it.
        keep = np.linalg.norm(np.cross(direction, beam.axis), axis=1) > 0.1
        origin, direction = origin[keep], direction[keep]
        t_min = as_float32(rng.uniform(0.01, 0.3, len(origin)))
        t_max = as_float32(t_min + rng.uniform(0.5, 4, len(origin)))
        expected = twin.billboard(beam, double, origin, direction, t_min, t_max)
        found = radiance(beam, origin, direction, look, "billboard", t_min=t_min, t_max=t_max)
        # Positions are rounded to EPSILON32 of up to 4 units, and closest approach divides that by sin² ≥ 0.01.
        places = smooth_part(beam, double, origin, direction, t_min, t_max, expected, 4 * EPSILON32 / 0.01)
        # Some 30 roundings, and a profile from a table of 1024 entries, whose error is 1024⁻² of its curvature.
        assert np.all(np.abs(found - expected) <= 2 * places + (30 * EPSILON32 + 2e-5) * expected.max() + 1e-12)
        assert np.count_nonzero(expected[:, 0]) > 20


@pytest.mark.parametrize("name", LOOKS)
def test_frustum_equals_its_twin_on_random_beams_and_rays(name, rng):
    look, double = LOOKS[name]
    for _ in range(12):
        beam = random_beam(rng)
        origin, direction = random_rays(rng, beam)
        t_min = as_float32(rng.uniform(0.0, 0.3, len(origin)))
        t_max = as_float32(t_min + rng.uniform(0.5, 4, len(origin)))
        expected = twin.frustum(beam, double, origin, direction, t_min, t_max)
        found = radiance(beam, origin, direction, look, "frustum", t_min=t_min, t_max=t_max)
        # A chord's ends are known to a few EPSILON32 of 4 units, against chords and radii of 0.02 and more; at a
        # pointed end the kernel goes on as 1/R², so relative to the largest value.
        assert np.abs(found - expected).max() <= 40 * EPSILON32 * 4 / 0.02 * expected.max()
        assert np.count_nonzero(expected[:, 0]) > 100
