"""Derivatives of estimates by every parameter of a look, against finite differences of the estimates themselves."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import looks
from photonbeams.estimators.estimate import bind
from photonbeams.runtime.device import Array3f, Float
from photonbeams.scene import SceneError
from tests.estimators.differentiable import CONVERGED, FOG, RAYS, array, numbers
from tests.helpers.kernels import compiled

CONTEXT = looks.LightContext(time=0.7)
COLOURS = [[1.0, 0.2, 0.1], [0.3, 0.9, 0.2], [0.1, 0.3, 1.0]]


def ramp(kind):
    return lambda k, r, g, b: looks.ColorRamp([0.1, k, 0.9], [COLOURS[0], [r, g, b], COLOURS[2]], kind)


#: A function that makes a factor, and its arguments. The step of a difference is a fraction of the argument.
FACTORS = {
    "exponential": (looks.Exponential, [1.7]),
    "exponential by channel": (lambda r, g, b: looks.Exponential([r, g, b]), [1.7, 2.5, 0.9]),
    "power": (looks.Power, [1.5, 0.8]),
    "polynomial": (lambda a, b, c, begin, end: looks.Polynomial([a, b, c], begin, end), [1.0, 0.5, -0.7, -0.1, 1.2]),
    "polynomial of colours": (lambda a, b: looks.Polynomial([[1, a, 1], [b, -0.2, 0.5]]), [0.7, 0.3]),
    "linear ramp": (ramp("linear"), [0.45, 0.4, 0.8, 0.3]),
    "smooth ramp": (ramp("smooth"), [0.45, 0.4, 0.8, 0.3]),
    "Catmull-Rom ramp": (ramp("catmull-rom"), [0.45, 0.4, 0.8, 0.3]),
    "monotone ramp": (ramp("monotone"), [0.45, 0.4, 0.8, 0.3]),
    "ramp of steps": (
        lambda r, g, b: looks.ColorRamp([0, 0.5, 1], [COLOURS[0], [r, g, b], COLOURS[2]], "none"), [0.4, 0.8, 0.3],
    ),
    "ramp from begin to end": (
        lambda begin, end: looks.ColorRamp([0.2, 0.5, 1], COLOURS, "smooth", begin, end, "distance"), [0.4, 3.5],
    ),
    "ramp of one colour": (lambda r, g, b: looks.ColorRamp([0.5], [[r, g, b]]), [0.4, 0.8, 0.3]),
    "fade": (looks.Fade, [0.5, 4.5]),
    "texture's place": (lambda begin, end: looks.Texture(COLOURS, begin, end), [-0.2, 1.3]),
    "constant": (looks.Constant, [0.7]),
    "constant of a colour": (lambda r, g: looks.Constant([r, g, 0.5]), [0.7, 0.4]),
    "number times attenuation": (lambda a: looks.Attenuation() * a, [0.7]),
    "sum": (lambda a, b: looks.Exponential(a) + b, [1.7, 0.3]),
    "mixture": (lambda a, b: looks.Exponential(a).mix(looks.Constant(0.2), b), [1.7, 0.3]),
    "clamp": (lambda a, b: looks.Polynomial([0, 1]).clamp(a, b), [0.3, 0.7]),
    "variation": (looks.Variation, [0.4]),
    "function": (lambda a: looks.Function(lambda s: dr.exp(-a * s)), [0.7]),
}  # fmt: skip
PROFILES = {
    "Gaussian": (looks.Gaussian, [0.4]),
    "smoothstep": (looks.Smoothstep, [0.3]),
    "hollow": (looks.Hollow, [0.3, 0.9]),
    "tabulated": (lambda a, b, c: looks.Tabulated([a, b, c, 0.0]), [1.0, 0.8, 0.5]),
    "function of the radius": (lambda a: lambda r: dr.exp(-a * r * r), [2.0]),
    "profile times a number": (lambda a: looks.Biweight() * a, [0.7]),
}
SLOTS = {
    **{f"along: {name}": ("along", *each) for name, each in FACTORS.items()},
    **{f"across: {name}": ("across", *each) for name, each in PROFILES.items()},
    "eye: exponential": ("eye", looks.Exponential, [2.5]),
    "angle: glow": ("angle", looks.Glow, [0.4, 0.6, 1.3]),
}
#: What the other slots have: the tests of a factor share their kernels.
PLAIN = {"along": 1.0, "eye": 1.0, "angle": 1.0, "across": looks.Biweight()}


@pytest.fixture(scope="module")
def scene():
    given, origin, direction = numbers()
    return pb.Beams(**given), (origin, direction), array(np.random.default_rng(5).uniform(0.2, 1, (RAYS, 3)))


def loss(scene, look, medium=FOG, **given):
    beams, rays, weights = scene
    found = pb.estimate(beams, *rays, 9.0, look=look, medium=medium, context=CONTEXT, **given)
    return dr.sum(found.array * dr.ravel(weights))


def differences(values, function):
    """Return central differences of a function by each of its arguments, with steps of a hundredth of the argument."""
    found = []
    for place, value in enumerate(values):
        ends = []
        for sign in (1, -1):
            moved = list(values)
            moved[place] = value + sign * 0.01 * abs(value)
            ends.append(float(function(moved)[0]))
        found.append((ends[0] - ends[1]) / (0.02 * abs(value)))
    return found


@pytest.mark.parametrize("name", SLOTS)
def test_of_every_number(scene, name):
    slot, make, values = SLOTS[name]
    attached = [Float(value) for value in values]
    dr.enable_grad(attached)
    dr.backward(loss(scene, pb.Look(**PLAIN | {slot: make(*attached)})))
    found = [float(dr.grad(each)[0]) for each in attached]

    def value(moved):
        return loss(scene, pb.Look(**PLAIN | {slot: make(*moved)}), estimator="frustum", rule=CONVERGED)

    expected = differences(values, value)
    # Differences err by the step's square, 1e-4, and by the rounding of a sum, 1e-6, divided by the step. On a chord
    # with corners twelve points err by some 1e-3 of the largest derivative. The derivative of a clamp by its limit is a
    # step: on it twelve points err by half a point's weight, a tenth, and over some 20 chords by a quarter of that.
    tolerance = 0.025 if "clamp" in name else 0.01
    assert found == pytest.approx(expected, rel=tolerance, abs=tolerance * max(map(abs, expected)))
    assert all(expected)


def test_of_noise_at_a_place(rng):
    """The derivatives of noise equal its finite differences.

    The noise is evaluated directly: the kernel of an estimate has it at twelve points and takes minutes to compile.
    """
    where = array(rng.uniform(-2, 2, (100, 3)))
    weights = Float(rng.uniform(-1, 1, 100))

    def value(numbers):
        amount, scale, contrast, drift, evolution = numbers
        noise = looks.Noise(amount, scale, 2, contrast, (drift, 0.1, 0.2), evolution)
        return dr.sum(noise.evaluate(looks.ShadingContext(place=lambda: where, context=CONTEXT)) * weights)

    values = [0.4, 1.5, 0.9, 0.3, 0.4]
    attached = [Float(value) for value in values]
    dr.enable_grad(attached)
    dr.backward(value(attached))
    expected = differences(values, value)
    found = [float(dr.grad(each)[0]) for each in attached]
    assert found == pytest.approx(expected, rel=0.01, abs=0.01 * max(map(abs, expected)))


def test_of_a_fog_of_ones_own_numbers(scene):
    def fog(r, g, b, a, c):
        return looks.Fog.of([r, g, b], a, c)

    values = [0.3, 0.2, 0.1, 0.05, 0.3]
    attached = [Float(value) for value in values]
    dr.enable_grad(attached)
    dr.backward(loss(scene, pb.Look(), fog(*attached)))
    found = [float(dr.grad(each)[0]) for each in attached]
    expected = differences(values, lambda moved: loss(scene, pb.Look(), fog(*moved), estimator="frustum"))
    assert found == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("name", ["origin", "direction", "t_max"])
def test_of_the_rays(scene, name):
    beams, (origin, direction), weights = scene
    rays = {"origin": origin, "direction": direction, "t_max": np.full(RAYS, 5.5)}

    def value(rays):
        found = pb.estimate(beams, **rays, medium=FOG, estimator="frustum", rule=CONVERGED)
        return dr.sum(found.array * dr.ravel(weights))

    tensor = dr.tensor_t(Float)(rays[name].astype(np.float32))
    dr.enable_grad(tensor)
    dr.backward(value({**rays, name: tensor}))
    found = dr.grad(tensor).numpy()
    assert found.shape == rays[name].shape
    for ray in np.argsort(-np.abs(found.reshape(RAYS, -1)[:, 0]))[:3]:
        place, step = ((ray,) if found.ndim == 1 else (ray, 0)), 2e-3
        ends = []
        for sign in (1, -1):
            moved = rays[name].copy()
            moved[place] += sign * step
            ends.append(float(value({**rays, name: moved})[0]))
        # The sum's rounding, 1e-6 of some tens, is divided by the step.
        assert found[place] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=0.02, abs=0.02)


def test_of_numbers_in_one_array_are_those_of_each(scene):
    def gradients(make, *given):
        dr.enable_grad(*given)
        dr.backward(loss(scene, pb.Look(along=make(*given))))
        return np.concatenate([np.ravel(dr.grad(each).numpy().T) for each in given])

    colours = np.array(COLOURS, dtype=np.float32)
    single = gradients(
        lambda *each: looks.ColorRamp([0, 0.5, 1], [each[0:3], each[3:6], each[6:9]]), *map(Float, colours.ravel())
    )
    vectors = gradients(lambda each: looks.ColorRamp([0, 0.5, 1], each), array(colours))
    tensor = dr.tensor_t(Float)(colours)
    dr.enable_grad(tensor)
    dr.backward(loss(scene, pb.Look(along=looks.ColorRamp([0, 0.5, 1], tensor))))
    np.testing.assert_allclose(vectors, single, rtol=1e-5)
    np.testing.assert_allclose(dr.grad(tensor).numpy().ravel(), single, rtol=1e-5)


def test_values_do_not_depend_on_whether_a_look_is_attached(scene):
    for name, (slot, make, values) in SLOTS.items():
        attached = [Float(value) for value in values]
        dr.enable_grad(attached)
        first, second = (
            pb.estimate(
                scene[0], *scene[1], 9.0, look=pb.Look(**PLAIN | {slot: make(*each)}), medium=FOG, context=CONTEXT
            )
            for each in ([float(value[0]) for value in dr.detach(attached)], attached)
        )
        # The same formula with the same float32 numbers; only a user's function computes with another constant.
        np.testing.assert_allclose(dr.detach(second).numpy(), first.numpy(), rtol=1e-5, err_msg=name)
        assert dr.grad_enabled(second) and not dr.grad_enabled(first), name


@pytest.mark.parametrize("name", [name for name in SLOTS if "function" not in name])
def test_a_step_of_an_optimiser_compiles_no_kernel(scene, name):
    slot, make, values = SLOTS[name]

    def step(scale):
        attached = [dr.opaque(Float, value * scale) for value in values]
        dr.enable_grad(attached)
        dr.backward(loss(scene, pb.Look(**PLAIN | {slot: make(*attached)})))
        dr.eval(dr.grad(attached))

    step(1.0)
    assert not compiled(step, 1.01)


def test_a_profile_keeps_its_light_while_its_numbers_change():
    """The integral of the density over the cross-section stays 1, so its derivative is 0."""
    rho = (np.arange(4096) + 0.5) / 4096
    for _, make, values in (SLOTS[name] for name in ("across: Gaussian", "across: hollow", "across: tabulated")):
        attached = [Float(value) for value in values]
        dr.enable_grad(attached)
        density = make(*attached).density(Float(np.square(rho, dtype=np.float64).astype(np.float32)))
        total = dr.sum(density * Float((2 * np.pi * rho / 4096).astype(np.float32)))
        assert float(total[0]) == pytest.approx(1, abs=1e-4)
        dr.backward(total)
        assert [float(dr.grad(each)[0]) for each in attached] == pytest.approx([0] * len(values), abs=1e-3)


def test_what_cannot_carry_a_gradient_says_so():
    number, colour, rows = Float(0.5), Array3f(1, 0.5, 0.2), Float([0.0, 0.5, 1.0])
    dr.enable_grad(number, colour, rows)
    for make, message in (
        (lambda: pb.Medium(colour), "scattering has gradients enabled, which would be lost"),
        (lambda: pb.Medium(1.0, 0.0, number), "anisotropy has gradients enabled"),
        (lambda: looks.ColorRamp(rows, COLOURS, "none"), "ramp of steps has gradients enabled for their positions"),
        (lambda: looks.ColorRamp([0, 0.5, 1], COLOURS, "none", number), "a step has no derivative by its position"),
        (lambda: pb.aim(colour, 0.5), "target has gradients enabled"),
        (lambda: pb.thin(number), "fraction has gradients enabled"),
        (lambda: pb.recolor(colour), "color has gradients enabled"),
        (lambda: pb.curved(np.eye(3), number, (1, 1, 1)), "radius has gradients enabled"),
        (lambda: looks.LightContext(time=number), "time has gradients enabled"),
        (lambda: pb.medium_of_colors(colour, (0.1, 0.1, 0.1)), "near has gradients enabled"),
    ):
        with pytest.raises(SceneError, match=message) as error:
            make()
        assert len(str(error.value)) <= 300


def test_a_bound_look_tells_whether_its_profile_is_attached(scene):
    number = Float(0.4)
    dr.enable_grad(number)
    bound = [bind(pb.Look(across=looks.Gaussian(each)), scene[0], None, FOG) for each in (0.4, number)]
    assert [each.attached for each in bound] == [False, True]
