"""Damaged files of every kind: what is read is right, or one sentence says what is wrong; nothing waits or crashes.

PHOTONBEAMS_DAMAGES is the number of damages of each file, by default a few: a longer run finds more.
"""

import logging
import os

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.images.files import read_parts, summaries
from photonbeams.images.plates import Holdout
from photonbeams.images.steady import FilmFrame
from photonbeams.images.tiles import join_tiles
from photonbeams.images.writing import write_png
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.sums import PassSums
from photonbeams.runtime.inputs import arrays, opened
from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST
from photonbeams.shot.development import Development, developed
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.lights.ies import parse
from photonbeams.usd.stage import default_time, open_stage, read_scene, sample_times
from photonbeams.volumes.vol import HEADER, read_vol
from photonbeams.world.checks import wrong_mesh
from tests.helpers import mutations
from tests.helpers.deep_files import write_deep
from tests.helpers.frames import write_frame
from tests.helpers.full_stage import STAGE

IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 5 2 1 2 0 0 0\n1 1 50\n0 22.5 45 67.5 90\n0 90\n" + "9 8 7 6 5\n" * 2
XML = """<scene version="3.0.0">
 <default name="size" value="8"/>
 <integrator type="photon_beams"/>
 <sensor type="perspective"><float name="fov" value="45"/><transform name="to_world">
  <lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
  <film type="hdrfilm"><integer name="width" value="$size"/><integer name="height" value="6"/></film></sensor>
 <medium type="heterogeneous" id="fog"><volume name="sigma_t" type="gridvolume">
  <string name="filename" value="whole.vol"/></volume><rgb name="albedo" value="0.9,0.9,0.9"/></medium>
 <emitter type="point"><point name="position" x="0" y="1" z="0"/><rgb name="intensity" value="5,5,5"/></emitter>
 <shape type="cube"><bsdf type="null"/><ref id="fog" name="interior"/></shape>
 <shape type="rectangle"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
  <string name="filename" value="whole.png"/></texture></bsdf></shape>
</scene>
"""


OBJ = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n-1 -1 0\n1 -1 0\n0 1 0\n3 0 1 2\n"


def count(usual):
    """Return how many damages of a file are tried."""
    return int(os.environ.get("PHOTONBEAMS_DAMAGES", usual))


def sums():
    """Return the sums of three passes of a picture of 4 x 6 pixels, with what is needed to develop it."""
    rng = np.random.default_rng(3)
    view = PassSums()
    for number in range(3):
        sizes = {"surface": (3, 24), "beams/": (3, 24), "alpha": 24, "light": 24, "squares": 24}
        view.add(number, {name: rng.random(size, dtype=np.float32) for name, size in sizes.items()})
    development = Development((4, 6), {"": "beams_default"}, {"": {"camera": "/C", "frame": 1.0}})
    return FrameSums([view], 3, 10, 20, "f" * 64, development.state())


def read_stage(path):
    stage = open_stage(path, warnings=Warnings())
    read_scene(stage, default_time(stage), Warnings())
    sample_times(stage, 8)


def read_exr(path):
    read_parts(path)
    summaries(path)
    join_tiles([path], path.with_name("joined.exr"))


def read_volume(path):
    with opened(path) as file:
        read_vol(file)


def read_mesh(path):
    scene = path.with_suffix(".xml")
    shape = f'<shape type="{path.suffix[1:]}"><string name="filename" value="{path.name}"/></shape>'
    scene.write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{shape}</scene>')
    assert not any(map(wrong_mesh, pb.Shot.open(scene).subject.load().shapes()))


READERS = {
    ".vol": (100, read_volume),
    ".ies": (100, lambda path: parse(path.read_bytes().decode("latin-1"))),
    ".png": (40, read_parts),
    ".exr": (80, read_exr),
    ".film.exr": (40, lambda path: FilmFrame.read(path).averaged([], [])),
    ".obj": (40, read_mesh),
    ".ply": (40, read_mesh),
    ".deep.exr": (150, lambda path: Holdout(path).read(1, [""], (8, 6), lambda _: None)),
    ".xml": (30, lambda path: pb.Shot.open(path)),
    ".usda": (30, read_stage),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a whole file of each kind."""
    result = tmp_path_factory.mktemp("whole")
    rng = np.random.default_rng(5)
    header = HEADER.pack(b"VOL", 3, 1, 4, 4, 4, 1, -1, -1, -1, 1, 1, 1)
    (result / "whole.vol").write_bytes(header + rng.random(64, dtype=np.float32).tobytes())
    (result / "whole.ies").write_text(IES)
    write_png(result / "whole.png", rng.random((6, 8, 3)))
    write_frame(result / "whole.exr", {"rgba": rng.random((6, 8, 4)), "depth": np.ones((6, 8, 1))}, {"camera": "/C"})
    light, still = {name: rng.random((6, 8, 4)) for name in ("rgba", "surface")}, {"worldToCamera": np.eye(4)}
    write_frame(result / "whole.film.exr", {**light, "depth": np.ones((6, 8, 1))}, {**still, "worldToNDC": np.eye(4)})
    (result / "whole.obj").write_text(OBJ)
    (result / "whole.ply").write_text(PLY)
    write_deep(result / "whole.deep.exr", lambda _, pixel: [(3.0, 3.5, 0.5)] * (pixel % 4), (8, 6), tiled=True)
    (result / "whole.xml").write_text(XML)
    (result / "whole.usda").write_text(STAGE)
    return result


@pytest.mark.parametrize("suffix", READERS)
def test_a_damaged_file_is_read_or_is_a_sentence(folder, suffix, caplog, capfd):
    caplog.set_level(logging.WARNING, "photonbeams")
    usual, read = READERS[suffix]
    whole = (folder / f"whole{suffix}").read_bytes()
    read(folder / f"whole{suffix}")
    for seed in range(count(usual)):
        path = folder / f"damaged{seed}{suffix}"  # OpenUSD and OpenImageIO keep what they read by name
        path.write_bytes(mutations.damaged(whole, seed))
        caplog.clear()
        try:
            read(path)
        except ValueError as error:  # SceneError is one
            assert type(error) is SceneError or isinstance(error, SceneError) or suffix == ".ies", (seed, error)
            assert len(str(error)) <= LONGEST, seed
        assert all(len(each.getMessage()) <= LONGEST for each in caplog.records), seed
        path.unlink()
    printed = capfd.readouterr()
    assert "Traceback" not in printed.err and not printed.out


def test_a_matrix_of_a_film_has_numbers(folder):
    name = b"worldToCamera\0m44f\0@\0\0\0"
    whole = (folder / "whole.film.exr").read_bytes()
    assert name in whole
    path = folder / "nan.film.exr"  # a NaN that NumPy warns of when it is converted
    path.write_bytes(whole.replace(name + whole[whole.index(name) + len(name) :][:4], name + b"\0\0\xa0\x7f"))
    with pytest.raises(SceneError, match="are no matrices of a camera"):
        FilmFrame.read(path)


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")
def test_a_damaged_checkpoint_is_the_picture_or_a_sentence(tmp_path):
    path = tmp_path / "a.checkpoint"
    sums().save(path)
    whole, members = path.read_bytes(), arrays(path)
    expected = developed(FrameSums.load(path)).layers
    for seed in range(count(250)):
        altered = seed % 2 == 0
        path.write_bytes(mutations.altered(members, seed) if altered else mutations.damaged(whole, seed))
        try:
            found = developed(FrameSums.load(path)).layers
        except SceneError as error:
            assert len(str(error)) <= LONGEST, seed
            continue
        assert found.keys() == expected.keys(), seed
        # A number that is another, with the right checksum, cannot be told from what a render wrote.
        assert altered or all(np.array_equal(found[name], expected[name]) for name in expected), seed


@pytest.mark.parametrize("lost", ["view 0/0+2/beams/", "view 0/2+1/surface", "names", "counts", "about", "development"])
def test_a_checkpoint_without_a_member_is_refused(tmp_path, lost):
    path = tmp_path / "a.checkpoint"
    state = sums().state()
    del state[lost]
    with path.open("wb") as file:
        np.savez(file, **state)
    with pytest.raises(SceneError, match=r"expected a checkpoint of photonbeams, but it (has|does not say)"):
        FrameSums.load(path)
