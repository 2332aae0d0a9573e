"""Media from colours: two colours give a fog and a power, and the picture shows those colours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import photonbeams as pb
from photonbeams.world.media.medium_colors import coefficients

NEAR, FAR = (1.0, 0.8, 0.5), (0.6, 0.4, 0.1)

channel = st.floats(1e-3, 1e3)
part = st.floats(0.1, 0.999)


@given(
    near=st.tuples(channel, channel, channel),
    parts=st.tuples(part, part, part),
    albedo=st.floats(0.01, 1.0),
    distance=st.floats(0.0, 5.0),
    far_distance=st.floats(0.5, 50.0),
    anisotropy=st.floats(-0.9, 0.9),
)
def test_the_colors_of_the_medium_of_colors_are_the_colors(near, parts, albedo, distance, far_distance, anisotropy):
    far = tuple(np.multiply(near, parts))
    options = {"distance": distance, "far_distance": far_distance, "radius": 0.3}
    medium, power = pb.medium_of_colors(near, far, albedo=albedo, anisotropy=anisotropy, **options)
    assert np.allclose(pb.colors_of_medium(medium, power, **options), [near, far], rtol=1e-9)
    assert np.allclose(np.divide(medium.scattering, medium.extinction), albedo)


def test_without_the_geometric_factor_the_power_is_the_published_formula():
    medium, power = pb.medium_of_colors(NEAR, FAR, albedo=0.8, distance=2.0, radius=0.25)
    ratio = np.divide(NEAR, FAR)
    assert np.allclose(medium.extinction, np.log(ratio))
    published = NEAR * ratio**2.0 / (0.8 * np.log(ratio))
    assert np.allclose(power, published / (8 / (3 * np.pi * 0.25) / (4 * np.pi)))


@pytest.mark.parametrize("profile", [None, pb.looks.Uniform(), pb.looks.Gaussian(), pb.looks.Smoothstep(0.7)])
@pytest.mark.parametrize("anisotropy", [0.0, 0.6])
def test_a_beam_seen_from_the_side_shows_the_colors_in_the_picture(profile, anisotropy):
    distance, radius = 2.5, 0.01
    medium, power = pb.medium_of_colors(
        NEAR, FAR, albedo=0.7, distance=distance, radius=radius, anisotropy=anisotropy, across=profile
    )
    beams = pb.Beams([[0, 0, 0]], [[3, 0, 0]], radius, radius, [power])
    begin = 2 * radius  # far enough from the beam's start that nothing is cut off
    origin = [[begin, 0, distance], [1.0, 0, distance]]
    options = {"look": pb.Look(across=profile), "medium": medium, "estimator": "frustum", "rule": pb.gauss_legendre(16)}
    seen = pb.estimate(beams, origin, [[0, 0, -1], [0, 0, -1]], **options).numpy()
    near = NEAR * np.exp(-np.asarray(medium.extinction) * begin)
    # The fog within the beam is thin: (σt R)² / 6 < 1e-4. Tabulated profiles add the error of their interpolation.
    assert np.allclose(seen[0], near, rtol=5e-4)
    assert np.allclose(seen[1], FAR, rtol=5e-4)


def test_a_far_color_is_kept_between_a_tenth_and_nearly_all_of_the_near_one():
    for far, kept in ((0.0, 0.1), (0.05, 0.1), (1.0, 0.999), (7.0, 0.999)):
        medium, _ = pb.medium_of_colors(1.0, far)
        assert np.allclose(medium.extinction, -np.log(kept))


def test_a_black_channel_has_the_fog_of_the_others_and_no_power():
    medium, power = pb.medium_of_colors((1.0, 0.0, 0.5), (0.5, 0.0, 0.1))
    assert np.allclose(medium.extinction, [np.log(2), np.log(10) / 2, np.log(5)])
    assert power[1] == 0
    assert power[0] > 0 and power[2] > 0


def test_the_unit_along_is_any_distance():
    whole = np.array(coefficients(NEAR, FAR, 0.5, far_distance=1.0))
    assert np.allclose(coefficients(NEAR, FAR, 0.5, far_distance=100.0), whole / 100)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((0.0, 0.0), {}, "near is 0.0: expected a colour that is not black"),
        ((-1.0, 0.5), {}, "near is -1.0: expected one or three finite numbers of at least 0"),
        ((1.0, float("nan")), {}, "far is nan: expected one or three finite numbers"),
        ((1.0, 0.5), {"albedo": 0.0}, "albedo is 0.0: expected one or three numbers above 0"),
        ((1.0, 0.5), {"albedo": (1, 1, 1.5)}, "albedo is .*: expected one or three numbers above 0"),
        ((1.0, 0.5), {"distance": -1.0}, "distance is -1.0: expected a finite number at least 0"),
        ((1.0, 0.1), {"distance": 1e3}, "distance is 1000: expected less"),
        ((1.0, 0.5), {"far_distance": 0.0}, "far distance is 0.0: expected a finite number"),
        ((1.0, 0.5), {"radius": 0.0}, "radius is 0.0: expected a number above 0"),
        ((1.0, 0.5), {"anisotropy": 1.0}, "anisotropy is 1.0: expected"),
    ],
)
def test_bad_numbers_are_named(arguments, options, message):
    with pytest.raises(pb.SceneError, match=message):
        pb.medium_of_colors(*arguments, **options)
