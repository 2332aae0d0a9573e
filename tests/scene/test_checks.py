"""Numbers as users give them: in any precision, and of NumPy's own kinds."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import Float
from photonbeams.scene import Camera, DensityGrid, Gobo, Mesh, Profile, SphereLight, UVTexture, VertexValues

KINDS = [float, np.float16, np.float32, np.float64, np.longdouble]


@pytest.mark.parametrize("kind", [*KINDS, Float])
@pytest.mark.parametrize(
    "make",
    [
        lambda kind: pb.Medium(1.0, anisotropy=kind(0.99)),
        lambda kind: pb.Medium(1.0, anisotropy=kind(-0.99)),
        lambda kind: pb.looks.Glow(kind(0.99)),
        lambda kind: pb.looks.Fog.of(1.0, 0.0, kind(-0.99)),
        lambda kind: pb.looks.Hollow(kind(0.99), kind(0.01)),
        lambda kind: pb.looks.Gaussian(kind(0.02)),
    ],
    ids=["medium", "medium below", "glow", "fog", "hollow", "gaussian"],
)
def test_a_bound_is_accepted_in_every_precision(make, kind):
    make(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_the_next_number_beyond_a_bound_is_refused(kind):
    own = np.float16 if kind is np.float16 else np.float32
    above = np.nextafter(own(0.99), own(1))
    with pytest.raises(pb.SceneError, match=r"anisotropy is 0\.99\d+: expected .* at most 0.99"):
        pb.Medium(1.0, anisotropy=kind(above))


def test_an_array_is_shown_as_its_numbers():
    with pytest.raises(pb.SceneError, match=r"^scattering is \[-0\.2, -0\.2, inf\]: expected "):
        pb.Medium(np.array([-0.2, -0.2, np.inf], np.float32))


MASKED = np.ma.array(np.ones((3, 3)), mask=np.eye(3) == 1)
ROW = MASKED[0]


@pytest.mark.parametrize(
    "make",
    [
        lambda: pb.Medium(ROW),
        lambda: pb.Medium([1.0, np.ma.masked, 1.0]),
        lambda: pb.Beams(MASKED, np.eye(3), 1.0, 1.0, np.eye(3)),
        lambda: pb.curved(MASKED, 0.1, (1, 1, 1)),
        lambda: pb.looks.ColorRamp([0, 0.5, 1], MASKED),
        lambda: pb.looks.Tabulated(ROW),
        lambda: SphereLight("/Lamp", 1.0, center=ROW),
        lambda: Camera.look_at(ROW, (0, 1, 0)),
        lambda: Camera("/Camera", MASKED),
        lambda: Mesh("/Mesh", MASKED, [[0, 1, 2]]),
        lambda: UVTexture(MASKED[..., None]),
        lambda: VertexValues(MASKED),
        lambda: DensityGrid(MASKED[..., None]),
        lambda: Gobo(MASKED[..., None]),
        lambda: Profile([0, 45, 90], [0], ROW[None]),
        lambda: pb.Holdout(MASKED),
        lambda: pb.Plate(MASKED[..., None]),
    ],
)
def test_masks_are_refused(make):
    with pytest.raises(pb.SceneError, match="has masked entries, which would be lost"):
        make()


def test_a_mask_of_nothing_is_an_array():
    assert pb.Medium(np.ma.array([1.0, 2.0, 3.0])).scattering == (1.0, 2.0, 3.0)
    assert pb.gauss_legendre(3).integrate(lambda x: x, np.ma.array([0.0]), 2.0) == pytest.approx(2)


def test_a_rule_refuses_a_mask():
    with pytest.raises(TypeError, match="expected a number, a NumPy array without a mask"):
        pb.gauss_legendre(3).integrate(lambda x: x, ROW, 2.0)


@pytest.mark.parametrize("four", [np.array(4), np.int64(4), np.array(4, np.uint8)])
def test_a_number_of_numpy_is_the_number_that_it_is(four):
    assert Settings(passes=four, beams=four, error=None) == Settings(passes=4, beams=4)
    lamp = SphereLight("/Lamp", 1.0, radius=four, seed=four)
    assert (lamp.radius, lamp.seed) == (4, 4) and not isinstance(lamp.radius, np.ndarray)


@pytest.mark.parametrize("yes", [np.bool_(True), np.array(True), np.array(1)])
def test_true_of_numpy_is_true(yes):
    assert Settings(denoise=yes, passes=yes).denoise is True
    assert SphereLight("/Lamp", 1.0, seen=yes).seen == SphereLight("/Lamp", 1.0, seen=1).seen == 1


def test_a_row_of_one_number_is_no_number():
    with pytest.raises(pb.SceneError, match=r"radius is \[0\.1\]: expected a number"):
        SphereLight("/Lamp", 1.0, radius=np.array([0.1]))
    with pytest.raises(pb.SceneError, match=r"passes is \[4\]: expected a whole number"):
        Settings(passes=np.array([4]))
