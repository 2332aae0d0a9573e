"""A disk that is full or loses bytes leaves the earlier files as they were, whoever writes and at every size."""

import errno
import re
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

import photonbeams as pb
from examples.vdb import write_vdb
from photonbeams import scene
from photonbeams.export.scene import Twin, _grid_of, ply
from photonbeams.export.shot import _write
from photonbeams.images import writing as images
from photonbeams.images.tiles import join_tiles
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.sums import PassSums
from photonbeams.runtime import files
from photonbeams.runtime.device import mitsuba
from photonbeams.studio.edits import Autosave
from photonbeams.usd.common.openusd import Gf, Sdf, Vt
from photonbeams.usd.layers.writing import write_layer
from tests.helpers.disks import limited
from tests.helpers.frames import write_frame

pytestmark = pytest.mark.usefixtures("helping_thread")

SOURCE = Path(pb.__file__).parent
SIZES = [1 << power for power in range(10, 21, 2)]  # bytes, from 1 kB to 1 MB


def noise(*shape):
    return np.random.default_rng(1).random(shape, dtype=np.float32)


def write_exr(path, size):
    write_frame(path, {"rgba": noise(8, size // 80, 4), "depth": noise(8, size // 80)})


def write_views(path, size):
    layers = {"rgba": noise(8, size // 160, 4), "depth": noise(8, size // 160)}
    write_frame(path, {}, views={"left": (layers, {}), "right": (layers, {})})


def write_tiles(path, size):
    tiles, right = [path.parent.parent / f"{size}-{number}.exr" for number in range(2)], size // 64
    if not tiles[0].exists():  # they lie on another disk
        for number, tile in enumerate(tiles):
            window = (np.array([0, 8 * number], np.int32), np.array([right, 8 * number + 7], np.int32))
            header = {"dataWindow": window, "displayWindow": (np.zeros(2, np.int32), np.array([right, 15], np.int32))}
            OpenEXR.File(header, {"Z": noise(8, right + 1)}).write(str(tile))
    join_tiles(tiles, path)


def write_checkpoint(path, size):
    sums = PassSums()
    sums.add(0, {"light": noise(size // 4)})
    FrameSums([sums], 1).save(path)


def write_beams(path, size):
    pb.Beams(noise(size // 48, 3), noise(size // 48, 3), 0.1, 0.2, noise(size // 48, 3)).save(path)


def write_stage(path, size):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    prim = Sdf.CreatePrimInLayer(layer, "/Noise")
    Sdf.AttributeSpec(prim, "noise", Sdf.ValueTypeNames.FloatArray).default = Vt.FloatArray.FromNumpy(noise(size // 5))
    # Binary files do not keep the signs of zeros in vectors, and NaN is not equal to itself.
    Sdf.AttributeSpec(prim, "zero", Sdf.ValueTypeNames.Float3).default = Gf.Vec3f(0.0, -0.0, -1.0)
    Sdf.AttributeSpec(prim, "unknown", Sdf.ValueTypeNames.Double).default = float("nan")
    write_layer(layer, path)


def write_autosave(path, size):
    """Write an autosave, which warns of a full disk instead of raising an error."""
    edits = Autosave(lambda: (path.with_suffix(""), "x" * size))
    edits.hold(path)
    edits.close()
    if edits._failed:
        raise OSError(errno.EFBIG, "File too large", str(path))


def write_export(path, size):
    """Write an .xml, and a mesh, a grid and an image beside it; the last one is the largest."""
    twin = Twin(path.stem)
    ply(twin, scene.Mesh("/Mesh", noise(size // 40, 3), np.arange(3 * (size // 120)).reshape(-1, 3)), "mesh")
    _grid_of(twin, "grid", noise(2, 3, size // 60, 1), scene.DensityGrid(noise(2, 2, 2), np.eye(4)))
    mi = mitsuba()
    twin.with_images({"bitmap": mi.Bitmap(noise(4, size // 40 + 1, 3))}, "image")
    folder = path.parent / twin.folder
    _write(path, "<scene/>", {folder / name: encode for name, encode in twin.files.items()})


WRITERS = {
    "old.exr": write_exr,
    "eyes.exr": write_views,
    "tiles.exr": write_tiles,
    "old.png": lambda path, size: images.write_png(path, noise(16, size // 48 + 1, 3)),
    "old.checkpoint": write_checkpoint,
    "old.npz": write_beams,
    "old.usda": write_stage,
    "old.usd": write_stage,
    "old.usdc": write_stage,
    "old.vdb": lambda path, size: write_vdb(path, {"density": noise(*[round((size / 2) ** (1 / 3))] * 3)}),
    "old.autosave": write_autosave,
    "old.xml": write_export,
}


@pytest.fixture(params=WRITERS)
def old(request, tmp_path):
    """Return the path of an earlier file, which is all that is in its folder."""
    path = tmp_path / "out" / request.param
    path.parent.mkdir()
    path.write_bytes(b"yesterday")
    return path


def check_untouched(old):
    assert old.read_bytes() == b"yesterday"
    assert list(old.parent.iterdir()) == [old]


def largest_of(old):
    """Return the size of the largest file that a writer wrote, and bring the earlier file back."""
    found = max(each.stat().st_size for each in old.parent.rglob("*") if each.is_file())
    for each in sorted(old.parent.rglob("*"), reverse=True):
        each.rmdir() if each.is_dir() else each.unlink()
    old.write_bytes(b"yesterday")
    return found


def test_a_full_disk_leaves_the_earlier_file_at_every_size(old):
    write = WRITERS[old.name]
    for size in SIZES:
        write(old, size)
        whole = largest_of(old)
        assert 0.3 * size < whole < 4 * size + 10_000
        for limit in (whole // 3, whole - 4097, whole - 1):
            with limited(max(limit, 0)), pytest.raises(OSError) as error:
                write(old, size)
            assert error.value.errno == errno.EFBIG
            assert Path(error.value.filename) == old or Path(error.value.filename).parent == old.with_suffix("")
            check_untouched(old)


@pytest.mark.parametrize("loss", ["end", "block", "everything"])
def test_what_a_disk_loses_in_silence_is_noticed_before_the_earlier_file_goes(old, loss, monkeypatch):
    def sync(path):
        """Lose bytes of a file as a disk does that tells of no error."""
        size = path.stat().st_size
        with path.open("r+b") as file:
            if path.suffix == ".xml":  # the files beside it are to be lost
                return
            if loss == "block":
                file.seek(size // 2)
                file.write(bytes(512))
            else:
                file.truncate(size - 1 if loss == "end" else 0)

    monkeypatch.setattr(files, "sync", sync)
    monkeypatch.setattr("photonbeams.usd.layers.writing.sync", sync)
    with pytest.raises(OSError):
        WRITERS[old.name](old, 1 << 14)
    check_untouched(old)


# Text that opens or writes a file.
WRITING = re.compile(
    r"""\.(write_text|write_bytes|tofile|Export)\(|\b(mkstemp|NamedTemporaryFile|ImageOutput|O_WRONLY|O_RDWR)\b"""
    r"""|\bopen\([^()]*"[rbt]*[wax+][bt+]*"|\.open\("[rbt]*[wax+]"""
)


def test_all_files_are_written_in_one_way():
    paths = [path for path in SOURCE.rglob("*.py") if WRITING.search(path.read_text(encoding="utf-8"))]
    # OpenUSD writes binary layers to a path alone. The command opens the null device for a closed stream. Blender's own
    # process has none of our modules, and writes to a temporary folder.
    ours = {path for path in paths if not path.is_relative_to(SOURCE / "blender" / "extension" / "reading")}
    assert {str(path.relative_to(SOURCE)) for path in ours} == {
        "cli/__init__.py", "runtime/files.py", "usd/layers/writing.py",
    }  # fmt: skip
