"""Derivatives of estimates against finite differences of the estimates themselves."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.estimators import gradients
from photonbeams.runtime.device import Array3f, Float
from photonbeams.scene import SceneError
from tests.estimators.differentiable import CONVERGED, FOG, RAYS, array, numbers

NAMES = ("start", "end", "radius_start", "radius_end", "power")


def loss(beams, rays, weights, **given):
    """Return a sum of radiances with a different weight for each ray and channel."""
    given.setdefault("medium", FOG)
    found = pb.estimate(beams, *rays, 9.0, **given)
    return dr.sum(found.array * dr.ravel(weights))


def difference(value, place, step, function):
    """Return the central difference of a function of an array at one of its places."""
    ends = []
    for sign in (1, -1):
        moved = np.array(value, dtype=np.float64)
        moved[place] += sign * step
        ends.append(float(function(moved)[0]))
    return (ends[0] - ends[1]) / (2 * step)


@pytest.fixture
def scene():
    beams, origin, direction = numbers()
    weights = array(np.random.default_rng(5).uniform(0.2, 1, (RAYS, 3)))
    return beams, (origin, direction), weights


@pytest.mark.parametrize("name", NAMES)
def test_of_beams(scene, name):
    given, rays, weights = scene
    beams = pb.Beams(**given)
    dr.enable_grad(getattr(beams, name))
    dr.backward(loss(beams, rays, weights))
    found = np.array(dr.grad(getattr(beams, name))).T
    scale = float(np.abs(found).max())
    for place in [(0,), (3,)] if found.ndim == 1 else [(0, 0), (2, 1), (5, 2)]:
        # The rule has converged, because an error of `auto` would be divided by the step. Differences err by the step's
        # square, and by the rounding of a sum, 1e-6, divided by the step.
        expected = difference(
            given[name], place, 5e-3,
            lambda moved: loss(pb.Beams(**{**given, name: moved}), rays, weights, estimator="frustum", rule=CONVERGED),
        )  # fmt: skip
        assert found[place] == pytest.approx(expected, abs=0.01 * scale)


@pytest.mark.parametrize("name", ["extinction", "scattering"])
def test_of_the_fog(scene, name):
    given, rays, weights = scene
    beams, fog = pb.Beams(**given), pb.looks.Fog(FOG)
    dr.enable_grad(getattr(fog, name))
    dr.backward(loss(beams, rays, weights, medium=fog))
    found = np.array(dr.grad(getattr(fog, name)))[:, 0]
    for channel in range(3):

        def value(moved):
            other = pb.looks.Fog(FOG)
            setattr(other, name, dr.opaque(Array3f, moved.tolist()))
            return loss(beams, rays, weights, medium=other)

        plain = np.array(getattr(FOG, name))
        expected = difference(plain, (channel,), 1e-2, value)
        assert found[channel] == pytest.approx(expected, rel=0.01)


def test_of_the_phase_function(scene):
    given, rays, weights = scene
    beams, fog = pb.Beams(**given), pb.looks.Fog(FOG)
    dr.enable_grad(fog.anisotropy)
    dr.backward(loss(beams, rays, weights, medium=fog))

    def value(moved):
        other = pb.looks.Fog(FOG)
        other.anisotropy = dr.opaque(Float, float(moved[0]))
        return loss(beams, rays, weights, medium=other)

    expected = difference([FOG.anisotropy], (0,), 1e-2, value)
    assert float(dr.grad(fog.anisotropy)[0]) == pytest.approx(expected, rel=0.01)


def textured(pixels):
    return pb.Look(along=pb.looks.Texture(pixels) * pb.looks.Attenuation())


def test_of_a_texture_along_the_beam(scene):
    given, rays, weights = scene
    beams = pb.Beams(**given)
    pixels = np.random.default_rng(1).uniform(0.2, 1, (5, 3))
    texture = array(pixels)
    dr.enable_grad(texture)
    dr.backward(loss(beams, rays, weights, look=textured(texture)))
    found = np.array(dr.grad(texture)).T
    for place in ((0, 0), (2, 1), (4, 2)):
        # The radiance is linear in the texture: a step may be large. On a chord with corners twelve points err by 1e-3.
        expected = difference(
            pixels, place, 0.1,
            lambda moved: loss(beams, rays, weights, look=textured(moved)),
        )  # fmt: skip
        assert found[place] == pytest.approx(expected, abs=0.01 * float(np.abs(found).max()))


def test_of_a_function_of_ones_own(scene):
    given, rays, weights = scene
    beams = pb.Beams(**given)

    def look(rate):
        return pb.Look(
            along=lambda s: dr.exp(-rate * s), across=pb.looks.Biweight(), eye=1.0, angle=lambda cosine: 1 + cosine
        )

    rate = Float(0.7)
    dr.enable_grad(rate)
    dr.backward(loss(beams, rays, weights, look=look(rate)))
    expected = difference([0.7], (0,), 1e-2, lambda moved: loss(beams, rays, weights, look=look(Float(moved[0]))))
    assert float(dr.grad(rate)[0]) == pytest.approx(expected, rel=0.01)


def test_forward_mode_agrees_with_backward_mode(scene):
    given, rays, weights = scene
    beams = pb.Beams(**given)
    dr.enable_grad(beams.radius_start)
    dr.set_grad(beams.radius_start, 1.0)
    value = loss(beams, rays, weights)
    dr.forward_to(value)
    forward = float(dr.grad(value)[0])
    beams = pb.Beams(**given)
    dr.enable_grad(beams.radius_start)
    dr.backward(loss(beams, rays, weights))
    assert forward == pytest.approx(float(dr.sum(dr.grad(beams.radius_start))[0]), rel=1e-3)


def test_values_do_not_depend_on_whether_there_are_derivatives(scene):
    given, rays, _ = scene
    plain, attached = pb.Beams(**given), pb.Beams(**given)
    dr.enable_grad(attached.start, attached.power)
    first, second = (pb.estimate(each, *rays, medium=FOG) for each in (plain, attached))
    assert np.array_equal(first.numpy(), dr.detach(second).numpy())
    assert dr.grad_enabled(second) and not dr.grad_enabled(first)


def test_of_rays_that_meet_nothing_they_are_zero(scene):
    given, _, _ = scene
    beams = pb.Beams(**given)
    dr.enable_grad(beams.power)
    found = pb.estimate(beams, [[0, 50, 0]], [[1, 0, 0]], medium=FOG)
    dr.backward(dr.sum(found, axis=None), dr.ADFlag.Default | dr.ADFlag.AllowNoGrad)
    assert not np.array(dr.grad(beams.power)).any()


def test_too_many_pairs_are_refused(scene, monkeypatch):
    given, rays, weights = scene
    monkeypatch.setattr(gradients, "MOST_PAIRS", 5)
    beams = pb.Beams(**given)
    dr.enable_grad(beams.power)
    with pytest.raises(SceneError, match=r"pairs of rays and beams have derivatives: expected at most 5"):
        loss(beams, rays, weights)
