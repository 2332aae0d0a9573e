"""Beams: the arrays that they accept and refuse, what they keep, and how they are saved."""

import re

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import Array3f, Float, UInt32
from photonbeams.scene import SceneError

COUNT = 5
VECTORS = ("start", "end", "end_normal", "start_tangent", "end_tangent")
NAMES = (*VECTORS, "radius_start", "radius_end", "power", "power_end", "offset", "total", "entry")


@pytest.fixture
def beams(rng):
    """Beams with every field set."""
    vectors = {name: rng.normal(size=(COUNT, 3)) for name in VECTORS}
    numbers = {name: rng.uniform(0.1, 1, COUNT) for name in ("radius_start", "radius_end", "offset", "total", "entry")}
    power, power_end = rng.uniform(0, 1, (2, COUNT, 3))
    return pb.Beams(**vectors, **numbers, power=power, power_end=power_end)


def same(a, b):
    first, second = a.arrays(), b.arrays()
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)


def test_numbers_for_all_are_broadcast():
    beams = pb.Beams(np.zeros((COUNT, 3)), np.ones((COUNT, 3)), 0.1, [0.2], (1, 2, 3))
    found = beams.arrays()
    assert len(beams) == COUNT and repr(beams) == "Beams(5)"
    assert found["radius_start"] == pytest.approx(np.full(COUNT, 0.1))
    assert found["radius_end"] == pytest.approx(np.full(COUNT, 0.2))
    assert np.array_equal(found["power"], np.tile([1, 2, 3], (COUNT, 1)))
    assert set(found) == {"start", "end", "radius_start", "radius_end", "power"}


def test_dr_jit_arrays_are_taken_as_they_are(beams):
    other = pb.Beams(**{name: getattr(beams, name) for name in NAMES})
    assert same(beams, other)
    wide = pb.Beams(dr.zeros(Array3f, 4), dr.ones(Array3f, 4), Float(0.5), Float(0.5), Array3f(1, 2, 3))
    assert dr.width(wide.radius_start) == 4 and dr.width(wide.power) == 4


def test_saved_and_loaded_beams_are_the_same(beams, tmp_path):
    beams.save(tmp_path / "beams.npz")
    assert same(beams, pb.Beams.load(tmp_path / "beams.npz"))
    assert [path.name for path in tmp_path.iterdir()] == ["beams.npz"]
    bare = pb.Beams([[0, 0, 0]], [[1, 0, 0]], 0.1, 0.1, [[1, 1, 1]])
    bare.save(tmp_path / "beams.npz")
    loaded = pb.Beams.load(tmp_path / "beams.npz")
    assert same(bare, loaded) and loaded.offset is None and loaded.end_normal is None


def test_no_beams_can_be_saved_too(tmp_path):
    none = pb.Beams(np.zeros((0, 3)), np.zeros((0, 3)), 0.1, 0.1, np.zeros((0, 3)))
    none.save(tmp_path / "none.npz")
    assert len(pb.Beams.load(tmp_path / "none.npz")) == 0


def test_a_failed_save_leaves_the_old_file(beams, tmp_path, monkeypatch):
    path = tmp_path / "beams.npz"
    path.write_bytes(b"old")

    def full(file, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space left"):
        beams.save(path)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_taken_beams_are_those_of_the_numbers(beams):
    found = beams.take(UInt32([3, 0, 3]))
    assert len(found) == 3
    for name, values in beams.arrays().items():
        assert np.array_equal(found.arrays()[name], values[[3, 0, 3]])


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 broken"])
def test_a_file_that_holds_no_beams_is_named(content, tmp_path):
    path = tmp_path / "beams.npz"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=r"beams\.npz: expected beams saved by photonbeams"):
        pb.Beams.load(path)
    with pytest.raises(SceneError, match=r"missing\.npz: .*there is no such file"):
        pb.Beams.load(tmp_path / "missing.npz")
    np.savez(path, start=np.zeros((2, 3)))
    with pytest.raises(SceneError, match=r"beams\.npz: "):
        pb.Beams.load(path)


GIVEN = {"start": [[0, 0, 0]] * 2, "end": [[0, 0, 1]] * 2, "radius_start": 0.1, "radius_end": 0.1, "power": (1, 1, 1)}


@pytest.mark.parametrize(
    ("message", "given"),
    [
        (r"end has shape \(3, 3\): expected \(2, 3\)", {"end": np.ones((3, 3))}),
        (r"start has shape \(2, 2\): expected \(2, 3\)", {"start": np.zeros((2, 2))}),
        (r"power is not given: expected numbers of shape \(N, 3\)", {"power": None}),
        (r"radius_start has shape \(3,\): expected \(2,\)", {"radius_start": [1, 2, 3]}),
        (r"end_normal has shape", {"end_normal": [0, 1]}),
        (r"radius_end has 3 entries: expected 2", {"radius_end": Float([1, 2, 3])}),
        (r"end of beam 1 is not finite", {"end": [[0, 0, 1], [0, np.nan, 1]]}),
        (r"power of beam 0 is not finite", {"power": [[np.inf, 1, 1], [1, 1, 1]]}),
        (r"offset of beam 1 is not finite", {"offset": [0, np.nan]}),
        (r"one of start_tangent and end_tangent is given: expected both", {"start_tangent": (0, 0, 1)}),
        (r"a radius is negative", {"radius_start": -0.1}),
        (r"both of a beam are 0", {"radius_start": [0.1, 0], "radius_end": [0.1, 0]}),
    ],
)
def test_bad_beams_are_told_in_a_sentence(message, given):
    with pytest.raises(SceneError, match=message):
        pb.Beams(**(GIVEN | given))


# -- None at all, sums, and fields that are set --------------------------------------------------------------------


NOTHING = [
    pb.Beams(),
    pb.Beams([], [], [], [], []),
    pb.Beams(np.zeros((0, 3)), np.zeros((0, 3)), 0.1, 0.2, (1, 2, 3)),
    pb.Beams([[0, 0, 0]], [[0, 0, 1]], 0.1, 0.2, (1, 2, 3), id=[7])[:0],
]


@pytest.mark.parametrize("none", NOTHING, ids=repr)
def test_no_beams_have_no_light_and_add_nothing(none, beams, tmp_path):
    assert len(none) == len(none[:0]) == len(none + none) == 0
    assert all(same(each, beams) for each in (none + beams, beams + none, sum([none, beams, none])))
    assert none.arrays()["power"].shape == (0, 3) and dr.width(none.identity()) == 0
    none.save(tmp_path / "none.npz")
    assert len(pb.Beams.load(tmp_path / "none.npz")) == 0
    assert not pb.estimate(none, [[-3, 0, 2]], [1, 0, 0], medium=pb.Medium(0.1)).numpy().any()
    modifiers = pb.aim((1, 0, 0)), pb.bend(lambda p: p), pb.bend([[[0, 0, 0], [0, 1, 1]]]), pb.thin(0.5), pb.clamp(1)
    assert len(pb.chain(*modifiers, pb.recolor((1, 2, 3)))(none, pb.PassContext())) == 0


def test_a_shot_may_lose_or_make_no_beams(capfd):
    lamp = pb.scene.SphereLight("/Lamp", 50.0, center=(0, 2, 0), shaping=pb.scene.Shaping(cone_angle=20))
    content = pb.scene.Scene(lights=lamp, media=pb.Medium(scattering=0.1))
    camera = pb.scene.Camera.look_at(origin=(6, 1, 0), target=(0, 1, 0))

    def light(**programs):
        return pb.Shot(content, camera, **programs).render(passes=1, width=16, beams=64, guiding=False).layers["beams"]

    assert not light(simulate=lambda beams, _: beams[:0]).any()
    plain = light()
    assert plain.any() and all(np.array_equal(light(emit=lambda _, own=own: own), plain) for own in (NOTHING[1], []))


def test_sum_joins_beams(beams):
    assert same(sum([beams, beams, beams]), pb.Beams.join([beams] * 3)) and sum([], NOTHING[0]) is NOTHING[0]
    for others in ([beams, 1], [1, beams], [beams, None]):
        with pytest.raises(SceneError, match="expected Beams"):
            sum(others)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("power", np.arange(3.0 * COUNT).reshape(COUNT, 3)),
        ("power", [[1, 2, 3]] * COUNT),
        ("power", (1, 2, 3)),
        ("power", Array3f(1, 2, 3)),
        ("radius_start", np.linspace(0, 1, COUNT)),
        ("radius_end", 0.25),
        ("id", range(COUNT)),
        ("start", dr.zeros(dr.tensor_t(Float), (COUNT, 3))),
        ("power_end", None),
    ],
    ids=str,
)
def test_a_field_is_set_as_the_constructor_takes_it(beams, name, value):
    made = pb.Beams(**{**beams.arrays(), name: value})
    setattr(beams, name, value)
    assert same(beams, made)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("power", np.ones((3, 3)), "Beams: power has shape (3, 3): expected (5, 3)"),
        ("power", Array3f([1, 2], 3, 4), "Beams: power has 2 entries: expected 5"),
        ("power", "red", "Beams: power is 'red'"),
        ("power", [(1, 2, np.nan)] * COUNT, "Beams: power of beam 0 is not finite"),
        ("start", None, "Beams: start is not given"),
        ("radius_start", -1, "a radius is negative"),
        ("powr", 1, "Beams has no argument 'powr', did you mean power?"),
    ],
)
def test_what_a_field_cannot_be_is_refused_and_changes_nothing(beams, name, value, message):
    before = beams.arrays()
    with pytest.raises(SceneError, match=re.escape(message)):
        setattr(beams, name, value)
    assert all(np.array_equal(before[name], after) for name, after in beams.arrays().items())
