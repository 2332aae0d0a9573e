"""Write kinds.vdb.gz and kinds.npz with OpenVDB's own Python module: the voxels that `test_vdb` expects.

Run by hand, with a Python that has the module (`apt-get install python3-openvdb`). Versions 10.0.1 (Debian) and 12.0.0
(in `pip install bpy`) of the library read the same voxels from the file.
"""

import gzip
from pathlib import Path

import numpy as np
import pyopenvdb as vdb

HERE = Path(__file__).parent / "data"
random = np.random.default_rng(7)


def grid(kind, background, name, array, first=(0, 0, 0), half=False):
    """Return a grid with an array in it."""
    result = kind(background)
    result.name, result.saveFloatAsHalf = name, half
    result.copyFromArray(array, ijk=first)
    return result


def noise(shape, density):
    """Return random numbers, all 0 except for the fraction `density`."""
    return (random.random(shape) * (random.random(shape) < density)).astype(np.float32)


sparse = grid(vdb.FloatGrid, 0.0, "sparse", noise((12, 9, 20), 0.3), first=(-6, 125, 4090))
sparse.transform = vdb.createLinearTransform([[0.5, 0.1, 0, 0], [-0.1, 0.5, 0, 0], [0, 0, 0.25, 0], [1, 2, 3, 1]])
half = grid(vdb.FloatGrid, 0.0, "half", noise((9, 9, 9), 0.9), half=True)
half.transform = vdb.createLinearTransform(0.2)
tiles = vdb.FloatGrid(0.0)
tiles.name = "tiles"
tiles.fill((0, 0, 0), (15, 7, 7), 2.0)
tiles.fill((16, 0, 0), (19, 7, 7), 0.5, active=False)
tiles.fill((20, 2, 2), (21, 5, 5), 3.0)
vectors = grid(vdb.Vec3SGrid, (0, 0, 0), "vectors", noise((5, 6, 7, 3), 0.5))
flags = grid(vdb.BoolGrid, False, "flags", random.random((10, 4, 4)) < 0.5)
sphere = vdb.createLevelSetSphere(radius=4.0, voxelSize=1.0, halfWidth=2.0)
sphere.name = "sphere"
twins = [grid(vdb.FloatGrid, 0.0, "twin", np.full((2, 2, 2), value, np.float32)) for value in (1.0, 2.0)]
instance = half.copy()  # which shares the tree
instance.name, instance.transform = "instance", vdb.createLinearTransform(0.7)
grids = [instance, sparse, half, tiles, vectors, flags, sphere, *twins]

vdb.write("/tmp/kinds.vdb", grids, {"creator": "make_kinds.py"})
(HERE / "kinds.vdb.gz").write_bytes(gzip.compress(Path("/tmp/kinds.vdb").read_bytes(), mtime=0))
expected = {}
for name in ("sparse", "half", "tiles", "vectors", "flags", "sphere", "twin[0]", "twin[1]", "instance"):
    each = vdb.read("/tmp/kinds.vdb", name)
    low, high = each.evalActiveVoxelBoundingBox()
    shape = tuple(np.array(high) - low + 1) + ((3,) if name == "vectors" else ())
    array = np.zeros(shape, bool if name == "flags" else np.float32)
    each.copyToArray(array, ijk=low)
    points = [each.transform.indexToWorld(point) for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
    expected |= {f"{name}/array": array, f"{name}/low": low, f"{name}/active": each.activeVoxelCount()}
    expected |= {f"{name}/corners": np.array(points)}
np.savez_compressed(HERE / "kinds.npz", **expected)
