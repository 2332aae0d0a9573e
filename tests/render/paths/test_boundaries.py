"""Camera paths through boundaries of fog that they graze."""

import numpy as np
import pytest

from photonbeams.render.paths import camera_paths
from photonbeams.runtime.device import mitsuba

mi = mitsuba()

ROWS, COLUMNS = 24, 48


def ball(path):
    """Write a sphere's mesh with ROWS x COLUMNS faces."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, ROWS + 1), 2 * np.pi * np.arange(COLUMNS) / COLUMNS, indexing="ij"
    )
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    row, column = (each.ravel() for each in np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), indexing="ij"))
    corners = [below * COLUMNS + side % COLUMNS for below in (row, row + 1) for side in (column, column + 1)]
    faces = np.concatenate([np.stack([corners[k] for k in each], axis=1) for each in ((0, 2, 3), (0, 3, 1))])
    mesh = mi.Mesh("ball", points.size // 3, len(faces))
    values = mi.traverse(mesh)
    values["vertex_positions"], values["faces"] = mi.Float(points.ravel()), mi.UInt32(faces.ravel().astype(np.uint32))
    values.update()
    mesh.write_ply(str(path))


@pytest.mark.parametrize("radius", [1.0, 0.1, 0.01])
def test_a_ray_that_grazes_a_boundary_goes_on(tmp_path, monkeypatch, radius):
    """A ray met the same triangle for ever: its pixel lost the light behind, and all others waited for 128 steps."""
    ball(tmp_path / "ball.ply")
    steps, batches = [], camera_paths._batches
    monkeypatch.setattr(camera_paths, "_batches", lambda further: steps.append(1) or batches(further))
    place = mi.ScalarTransform4f()
    scene = mi.load_dict({
        "type": "scene", "sky": {"type": "constant"},
        "ball": {"type": "ply", "filename": str(tmp_path / "ball.ply"), "to_world": place.scale(radius),
                 "bsdf": {"type": "null"}, "interior": {"type": "homogeneous", "sigma_t": 1e-3, "albedo": 0.5}},
        "sensor": {"type": "perspective", "fov": 30 * radius,
                   "to_world": place.look_at(origin=[0.3, 0.5, 4], target=[0, 0, 0], up=[0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": 256, "height": 256, "rfilter": {"type": "box"}}},
    })  # fmt: skip
    found = np.array(mi.render(scene, integrator=mi.load_dict({"type": "photon_beams", "method": "paths"}), spp=4))
    assert len(steps) < 16
    # One of four samples that is lost leaves 0.75. In the smallest ball, the gap beside a surface is longer than some
    # ways through it.
    assert np.mean(found < 0.95) < (1e-4 if radius < 0.1 else 1e-9)
