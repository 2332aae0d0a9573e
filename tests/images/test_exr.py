"""What is read of an EXR is all that its header names, or one sentence that names the file."""

import os
import struct
from fractions import Fraction

import numpy as np
import OpenEXR
import pytest

from photonbeams.images.exr import exr_parts
from photonbeams.images.files import read_parts
from photonbeams.images.plates import Holdout, Plate
from photonbeams.images.steady import FilmFrame
from photonbeams.images.tiles import join_tiles
from photonbeams.scene import Camera, SceneError
from photonbeams.scene.checks import LONGEST
from photonbeams.world.cameras.cameras import View, Window
from tests.helpers import mutations
from tests.helpers.frames import write_frame

WIDTH, HEIGHT = 40, 64
# Steps, so that it is stored compressed, with a checksum: of pixels that are stored as they are, no damage is known.
RAMP = np.linspace(0, 16, WIDTH * HEIGHT // 2, dtype=np.float32).reshape(HEIGHT // 2, WIDTH, 1) // 1 / 16
LAYERS = {"rgba": RAMP * np.ones(4), "surface": RAMP * np.ones(3), "beams": RAMP * np.zeros(3), "depth": 1 + RAMP}


def tile(path, number, **more):
    """Write the upper half of a picture, 0, or the lower one, 1, with more attributes."""
    top = number * HEIGHT // 2
    header = View(Camera.look_at((0, 0, 5), (0, 0, 0)), Window.full(WIDTH, HEIGHT)).header()
    header |= {"dataWindow": (0, top, WIDTH - 1, top + HEIGHT // 2 - 1)} | more
    write_frame(path, LAYERS, header)
    return path


def cut(data):
    """Return a file whose end is missing: its header is whole, and no part can be read."""
    return data[: data.rindex(b"screenWindowWidth") + 600]


def pixels(path):
    """Return the bytes of all channels: a damaged header with another name cannot be told from a whole one."""
    return sorted(each.pixels.tobytes() for part in exr_parts(path, deep=True) for each in part.channels.values())


@pytest.mark.parametrize("lacking", [0, 1])
def test_a_picture_says_what_any_of_its_tiles_lacked(tmp_path, lacking):
    lacked = ["leaves.png", "smoke.0003.vdb"]
    paths = [tile(tmp_path / f"{k}.exr", k, **({"missing": lacked} if k == lacking else {})) for k in (0, 1)]
    join_tiles(paths, tmp_path / "whole.exr")
    assert all([*part.header["missing"]] == lacked for part in exr_parts(tmp_path / "whole.exr", header_only=True))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_tile_whose_end_is_missing_is_refused_wherever_it_stands(tmp_path, capfd, order):
    paths = [tile(tmp_path / f"{number}.exr", number) for number in (0, 1)]
    join_tiles(paths, tmp_path / "whole.exr")
    assert np.array_equal(
        read_parts(tmp_path / "whole.exr")[1].pixels, np.tile(LAYERS["surface"], (2, 1, 1)).astype("e")
    )
    paths[0].write_bytes(cut(paths[0].read_bytes()))
    with pytest.raises(SceneError, match=rf"^{paths[0]} cannot be read: expected an image .*the end is missing.$"):
        join_tiles([paths[k] for k in order], tmp_path / "o.exr")
    assert not (tmp_path / "o.exr").exists()
    assert capfd.readouterr() == ("", "")  # OpenEXR's own lines


def test_a_tile_that_lacks_what_tiles_of_a_picture_share_is_told_from_one_with_another(tmp_path):
    paths = [tile(tmp_path / "0.exr", 0, seed=3), tile(tmp_path / "1.exr", 1)]
    for first, second, problem in (*paths, "no seed, unlike"), (*paths[::-1], "another seed than"):
        with pytest.raises(SceneError, match=rf"^{second}: has {problem} {first}: expected tiles of one picture"):
            join_tiles([first, second], tmp_path / "o.exr")


def test_a_header_with_a_fraction_over_zero_is_refused(tmp_path):
    path = tile(tmp_path / "0.exr", 0, framesPerSecond=Fraction(24, 7))
    path.write_bytes(path.read_bytes().replace(struct.pack("<iI", 24, 7), struct.pack("<iI", 24, 0)))
    with pytest.raises(SceneError, match=rf"^{path} cannot be read: .*a fraction over 0"):
        exr_parts(path, header_only=True)


def test_a_header_with_chromaticities_that_are_not_finite_is_refused(tmp_path):
    path = tile(tmp_path / "0.exr", 0, chromaticities=(0.25, *[0.5] * 7))
    path.write_bytes(path.read_bytes().replace(struct.pack("<2f", 0.25, 0.5), struct.pack("<2f", np.nan, 0.5)))
    with pytest.raises(SceneError, match=rf"^{path} cannot be read: .*chromaticities that are not finite"):
        join_tiles([path], tmp_path / "o.exr")


@pytest.mark.parametrize("layer", ["", "rgba.", "ViewLayer.Combined."])
@pytest.mark.parametrize("letters", ["RGB", "RGBA", "RGBAZ", "RG"])
def test_channels_in_named_layers_are_whole(tmp_path, layer, letters):
    """Single-part files of other programs have them; OpenEXR returns colours as one array, by the layer's name."""
    values = {f"{layer}{letter}": RAMP[..., 0] + number for number, letter in enumerate(letters)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, dict(values)).write(str(tmp_path / "a.exr"))
    join_tiles([tmp_path / "a.exr"], tmp_path / "b.exr")
    (found,) = exr_parts(tmp_path / "b.exr", deep=True)  # deep: each channel by itself
    assert {name: channel.pixels.tolist() for name, channel in found.channels.items()} == {
        name: pixels.tolist() for name, pixels in values.items()
    }


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")  # of damaged matrices
def test_what_is_read_of_a_damaged_exr_is_whole_or_refused(tmp_path):
    """PHOTONBEAMS_DAMAGES is the number of damages: a longer run finds more."""
    neighbour = tile(tmp_path / "neighbour.exr", 0)
    whole, expected, film = neighbour.read_bytes(), pixels(neighbour), FilmFrame.read(neighbour)
    path, joined = tmp_path / "damaged.exr", tmp_path / "joined.exr"
    refused = 0
    for seed in range(int(os.environ.get("PHOTONBEAMS_DAMAGES", 150))):
        path.write_bytes(mutations.damaged(whole, seed))
        for read in (
            lambda: exr_parts(path) and pixels(path),
            lambda: join_tiles([path], joined) and pixels(joined),
            lambda: FilmFrame.read(path).averaged([], []).write(joined) or pixels(joined),
        ):
            try:
                found = read()
            except SceneError as error:
                assert str(error).startswith(f"{path}") and len(str(error)) <= LONGEST, seed
                refused += 1
            else:
                assert len(found) == len(expected) and all(map(np.array_equal, found, expected)), seed
        try:
            film.averaged([FilmFrame.read(path)], [])
        except SceneError as error:
            assert len(str(error)) <= LONGEST, seed
    assert refused > seed  # most damages are found


@pytest.mark.parametrize("kind", [Holdout, Plate])
def test_a_plate_whose_end_is_missing_is_refused_before_anything_is_rendered(tmp_path, kind):
    path = tile(tmp_path / "plate.exr", 0)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(SceneError, match=r"plate\.exr cannot be read: expected an image .*the end is missing"):
        kind(path).check(1.0, [""], (WIDTH, HEIGHT))


def part(name, window, kind=np.float16):
    """Return a part with one channel, in a window of x0, y0, x1, y1."""
    x0, y0, x1, y1 = window
    header = {"type": OpenEXR.scanlineimage, "dataWindow": (np.array([x0, y0], np.int32), np.array([x1, y1], np.int32))}
    header["displayWindow"] = np.zeros(2, np.int32), np.full(2, 7, np.int32)
    return OpenEXR.Part(header, {"Z": np.ones((y1 + 1 - y0, x1 + 1 - x0), kind)}, name)


@pytest.mark.parametrize(
    ("second", "sentence"),
    [
        ([part("a", (0, 4, 7, 7)), part("b", (0, 3, 7, 6))], "layers have several data windows"),
        ([part("a", (0, 4, 7, 7)), part("b", (0, 4, 7, 7), np.float32)], "layer b is stored in another way"),
    ],
)
def test_tiles_whose_layers_differ_are_refused(tmp_path, second, sentence):
    first = [part(name, (0, 0, 7, 3)) for name in "ab"]
    paths = [tmp_path / "1.exr", tmp_path / "2.exr"]
    for path, parts in zip(paths, (first, second), strict=True):
        OpenEXR.File(parts).write(str(path))
    with pytest.raises(SceneError, match=rf"^{paths[1]}: .*{sentence}"):
        join_tiles(paths, tmp_path / "o.exr")


@pytest.mark.parametrize("matrix", [np.zeros((4, 4)), np.full((4, 4), np.nan)])
def test_a_film_with_a_damaged_matrix_is_refused(tmp_path, matrix):
    path = tmp_path / "a.exr"
    header = View(Camera.look_at((0, 0, 5), (0, 0, 0)), Window.full(WIDTH, HEIGHT // 2)).header()
    write_frame(path, LAYERS, header | {"worldToCamera": matrix})
    with pytest.raises(
        SceneError, match=r"a\.exr: worldToCamera and worldToNDC in its header are no matrices of a camera"
    ):
        FilmFrame.read(path)
