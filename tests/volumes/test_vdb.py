"""OpenVDB files: voxels as OpenVDB's own library reads them, and files that are broken."""

import gzip
import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from examples.vdb import write_vdb
from photonbeams.runtime.inputs import opened
from photonbeams.scene import SceneError
from photonbeams.volumes.dense import parts_of, voxels_of
from photonbeams.volumes.vdb import read_grids

DATA = Path(__file__).parent / "data"
KINDS = gzip.decompress((DATA / "kinds.vdb.gz").read_bytes())


@pytest.fixture(scope="module")
def grids():
    return read_grids(io.BytesIO(KINDS))


@pytest.fixture(scope="module")
def expected():
    with np.load(DATA / "kinds.npz") as file:
        return dict(file)


def named(grids, name):
    name, _, index = name.partition("[")
    return [each for each in grids if each.name == name][int(index.rstrip("]") or 0)]


def at(voxels, points):
    """Return values at points (N, 3) of the file's space, linear between the centres of cells, 0 outside."""
    inverse = np.linalg.inv(voxels.to_file)
    places = (points @ inverse[:3, :3].T + inverse[:3, 3]) * voxels.values.shape[2::-1] - 0.5
    channels = voxels.values.reshape(*voxels.values.shape[:3], -1)
    found = [map_coordinates(each, places.T[::-1], order=1, mode="constant") for each in np.moveaxis(channels, 3, 0)]
    return np.stack(found, axis=-1)


@pytest.mark.parametrize("name", ["sparse", "half", "tiles", "vectors", "flags", "twin[0]", "twin[1]", "instance"])
def test_voxels_are_those_of_openvdb(grids, expected, name):
    grid, array = named(grids, name), expected[f"{name}/array"]
    assert grid.tree.active_voxels == expected[f"{name}/active"]
    assert np.array_equal(grid.tree.box[0], expected[f"{name}/low"])
    found = voxels_of(grid).values[1:-1, 1:-1, 1:-1]
    assert np.array_equal(found.swapaxes(0, 2), array.astype(np.float32))


@pytest.mark.parametrize("name", ["sparse", "half", "tiles", "instance"])
def test_transforms_are_those_of_openvdb(grids, expected, name):
    corners = np.array([[0, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]])
    assert np.allclose((corners @ named(grids, name).to_file.T)[:, :3], expected[f"{name}/corners"], atol=1e-6)


def test_a_level_set_becomes_a_density(grids, expected):
    distance = expected["sphere/array"]
    found = voxels_of(named(grids, "sphere"))
    assert np.allclose(found.values[1:-1, 1:-1, 1:-1].swapaxes(0, 2), np.clip(-distance / 2, 0, 1), atol=1e-6)
    assert at(found, np.zeros((1, 3))) == 1


def test_a_dense_box_is_interpolated_as_openvdb_does(grids):
    grid = named(grids, "sparse")
    box = voxels_of(grid)
    index = np.array([[-6, 125, 4090], [5, 133, 4109], [-6.5, 125, 4090], [-7, 125, 4090], [0.25, 130, 4100]])
    corners = {tuple(each): at(box, (np.array([each]) @ grid.to_file[:3, :3].T) + grid.to_file[:3, 3])[0, 0]
               for each in ([-6, 125, 4090], [0, 130, 4100], [1, 130, 4100])}  # fmt: skip
    found = at(box, index @ grid.to_file[:3, :3].T + grid.to_file[:3, 3])[:, 0]
    assert found[2] == pytest.approx(corners[-6, 125, 4090] / 2, abs=1e-6)
    assert found[3] == pytest.approx(0, abs=1e-6)
    assert found[4] == pytest.approx(0.75 * corners[0, 130, 4100] + 0.25 * corners[1, 130, 4100], abs=1e-6)


@pytest.mark.parametrize("name", ["sparse", "tiles", "vectors"])
def test_cells_of_a_coarse_box_have_the_mean_of_their_voxels(grids, expected, name):
    grid, array = named(grids, name), expected[f"{name}/array"].astype(np.float32)
    coarse = voxels_of(grid, most=1200)
    step = coarse.step
    assert step > 1
    cells = [-(-count // step) for count in array.shape[:3]]
    whole = np.zeros([*(step * each for each in cells), *array.shape[3:]], np.float32)
    whole[tuple(slice(0, count) for count in array.shape[:3])] = array
    means = whole.reshape(cells[0], step, cells[1], step, cells[2], step, -1).mean(axis=(1, 3, 5))
    found = coarse.values[1:-1, 1:-1, 1:-1].swapaxes(0, 2)
    assert np.allclose(found.reshape(*cells, -1), means, atol=1e-6)
    # The box is at the same place, larger by the parts of cells that have no voxels.
    fine = voxels_of(grid).to_file
    edges = coarse.to_file[:3, :3] / (np.array(cells) + 2)
    assert np.allclose(edges, step * fine[:3, :3] / (np.array(array.shape[:3]) + 2))
    assert np.allclose(coarse.to_file[:3, 3] + edges.sum(axis=1), fine[:3, 3] + edges.sum(axis=1) / step)


@pytest.fixture
def puffs(tmp_path):
    """Return a grid with puffs at places (x, y, z), and its array (X, Y, Z)."""

    def make(*places, size=12, shape=(40, 40, 300)):
        values = np.zeros(shape, np.float32)
        for index, (x, y, z) in enumerate(places):
            values[x : x + size, y : y + size, z : z + size] += np.random.default_rng(index).random([size] * 3)
        path = tmp_path / "puffs.vdb"
        write_vdb(path, {"density": values.transpose(2, 1, 0)}, np.diag([*map(float, shape), 1.0]), half=False)
        with opened(path) as file:
            return read_grids(file)[0], values

    return make


def mass(boxes):
    """Return the integral of a density over its boxes."""
    return sum(
        float(each.values.sum(dtype=float)) / np.prod(each.values.shape) * abs(np.linalg.det(each.to_file[:3, :3]))
        for each in boxes
    )


def test_puffs_that_are_far_apart_have_boxes_of_their_own(puffs):
    """One box around them would have every third voxel along an axis."""
    grid, values = puffs((2, 3, 4), (25, 3, 280))
    whole, boxes = voxels_of(grid, most=20_000), parts_of(grid, most=20_000)
    assert whole.step > 2 and [each.step for each in boxes] == [1, 1]
    assert mass(boxes) == pytest.approx(float(values.sum()), rel=1e-5)
    places = np.argwhere(values > 0)
    found = sum(at(each, places + 0.5)[:, 0] for each in boxes)
    np.testing.assert_allclose(found, values[tuple(places.T)], rtol=1e-5)


def test_boxes_of_parts_do_not_overlap_and_keep_the_mass_where_they_are_coarse(puffs, rng):
    for _ in range(4):
        places = [rng.integers(0, (28, 28, 288)).tolist() for _ in range(5)]
        grid, values = puffs(*places)
        boxes = parts_of(grid, most=4_000)
        assert boxes[0].step > 1
        assert mass(boxes) == pytest.approx(float(values.sum()), rel=1e-4)
        corners = [(each.to_file[:3, 3], each.to_file[:3, :3].sum(axis=1) + each.to_file[:3, 3]) for each in boxes]
        for number, (low, high) in enumerate(corners):
            assert all((low >= last).any() or (high <= first).any() for first, last in corners[:number])


def test_a_grid_of_one_part_or_of_very_many_has_few_boxes(puffs, rng):
    grid, _ = puffs((2, 3, 4), (2, 3, 14))
    assert len(parts_of(grid, most=2_000)) == 1
    many = [(int(x), int(y), int(z)) for x in (0, 16, 32) for y in (0, 16, 32) for z in range(0, 290, 16)]
    grid, values = puffs(*many, size=4)
    boxes = parts_of(grid, most=30_000)
    assert 1 <= len(boxes) <= 16 and mass(boxes) == pytest.approx(float(values.sum()), rel=1e-4)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_written_is_read(tmp_path, half, channels):
    # OpenVDB 10.0.1 and 12.0.0 read the same voxels from these files.
    values = np.zeros((10, 9, 140, channels), np.float32)
    values[2:8, 1:9, 3:137] = np.random.default_rng(3).random((6, 8, 134, channels))
    values = values.astype(np.float16 if half else np.float32)
    box = np.array([[14, 1, 0, -3], [0, 9, 0, 0], [0, 0, 5, 2], [0, 0, 0, 1]], dtype=float)
    path = tmp_path / "smoke.vdb"
    write_vdb(path, {"density": values[..., 0] if channels == 1 else values, "other": values[..., 0]}, box, half)
    with opened(path) as file:
        first, other = read_grids(file)
    assert (first.name, first.type, first.half, first.codec) == (
        "density", "float" if channels == 1 else "vec3s", half, "zip, active voxels",
    )  # fmt: skip
    found = voxels_of(first)
    assert np.array_equal(found.values.reshape(8, 10, 136, -1)[1:-1, 1:-1, 1:-1], values[2:8, 1:9, 3:137])
    center = box @ [70.5 / 140, 5.5 / 9, 4.5 / 10, 1]
    assert np.allclose(at(found, center[None, :3]), values[4, 5, 70])
    assert other.tree.active_voxels == np.count_nonzero(values[..., 0])


def of_version(number):
    return KINDS[:8] + struct.pack("<I", number) + KINDS[12:]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "it has 0 bytes"),
        (b"x" * 100, "it is no OpenVDB file"),
        (of_version(219), "its format has the version 219: expected 222 to 225"),
        (KINDS[:20] + b"\0" + KINDS[21:], "it is a stream"),
        (KINDS[:57], "it ends too early"),
        (KINDS[:-2000], "is not within it|are not within it"),
    ],
)
def test_broken_files_are_refused_in_a_sentence(data, message):
    with pytest.raises(SceneError, match=message):
        for grid in read_grids(io.BytesIO(data)):
            voxels_of(grid)


def test_changed_bytes_are_refused_in_a_sentence_or_read(tmp_path):
    path = tmp_path / "smoke.vdb"
    write_vdb(path, {"density": np.random.default_rng(0).random((9, 9, 9))})
    original, random = path.read_bytes(), np.random.default_rng(5)
    refused = 0
    for place in (*range(60, 420, 3), *random.integers(0, len(original), 120)):
        data = bytearray(original)
        data[place] ^= int(random.integers(1, 256))
        try:
            for grid in read_grids(io.BytesIO(bytes(data))):
                voxels_of(grid, most=4096)
        except SceneError as error:
            refused += 1
            assert len(str(error)) < 200
    assert refused > 20


def test_a_block_that_lies_about_its_size_is_refused():
    from photonbeams.volumes.bytes import BLOSC, ZIP, Cursor

    bomb = zlib.compress(bytes(1 << 20))
    with pytest.raises(SceneError, match="a block is not as long"):
        Cursor(struct.pack("<q", 10) + bytes(10)).block(64, BLOSC)
    assert len(Cursor(struct.pack("<q", len(bomb)) + bomb).block(64, ZIP)) == 64  # and no more was unpacked
    claim = struct.pack("<4B3I", 2, 1, 1, 4, 1 << 31, 1 << 31, 24) + bytes(8)
    with pytest.raises(SceneError, match="a block is not as long as it says"):
        Cursor(struct.pack("<q", len(claim)) + claim).block(2048, BLOSC)


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(SceneError, match="it is a folder"):
        opened(tmp_path)
    with pytest.raises(SceneError, match="there is no such file"):
        opened(tmp_path / "none.vdb")
