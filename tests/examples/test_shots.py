"""The shots forest, concert and smoke in examples/ are what their scripts write, and show what they demonstrate."""

import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
from pxr import UsdGeom

import photonbeams as pb
from photonbeams.volumes.dense import voxels_of
from photonbeams.volumes.vdb import read_grids
from tests.helpers.sweep import sweep

EXAMPLES = Path(__file__).parents[2] / "examples"
GROUPS = {"forest": ["sky", "sun"], "concert": ["back", "floor", "key"], "smoke": ["projector", "rim"]}
NUMBER = re.compile(r"-?\b\d+(?:\.\d+)?(?:e[-+]?\d+)?\b")


def stage_of(name):
    return EXAMPLES / name / f"{name}.usda"


def opened(name, *overrides, beams=64):
    """Return a shot with few beams for each light."""
    lights = [light.name for light in pb.Shot.open(stage_of(name)).read(1)[0].lights]
    few = [f"{light}.photonbeams:count={beams}" for light in lights]
    return pb.Shot.open(stage_of(name), overrides=[*overrides, *few])


def rendered(shot, frame=1, width=64, passes=1, **settings):
    return {k: v.astype(np.float64) for k, v in shot.render(frame, passes, width=width, **settings).layers.items()}


@pytest.mark.parametrize("name", GROUPS)
def test_the_committed_stage_is_what_its_script_writes(name, tmp_path):
    for source in EXAMPLES.glob("*.py"):
        shutil.copy(source, tmp_path)
    folder = tmp_path / name
    folder.mkdir()
    for source in (EXAMPLES / name).glob("*.py"):
        shutil.copy(source, folder)
    where = {**os.environ, "PYTHONPATH": str(Path(pb.__file__).parents[1])}
    subprocess.run([sys.executable, folder / "model.py"], check=True, env=where, stdout=subprocess.DEVNULL)
    texts = [path.read_text() for path in (folder / f"{name}.usda", stage_of(name))]
    assert NUMBER.sub("#", texts[0]) == NUMBER.sub("#", texts[1])
    # Numbers are rounded to a thousandth; another processor's sine may round some differently.
    written, committed = (np.array(NUMBER.findall(text), dtype=float) for text in texts)
    assert np.abs(written - committed).max() < 0.0021
    for path in (EXAMPLES / name).glob("*.png"):
        levels = [OpenImageIO.ImageBuf(str(each)).get_pixels(OpenImageIO.UINT8) for each in (folder / path.name, path)]
        assert np.mean(levels[0] != levels[1]) < 1e-3
    for path in (EXAMPLES / name).glob("*.vdb"):
        (written,), (committed,) = (read_grids(io.BytesIO(each.read_bytes())) for each in (folder / path.name, path))
        # The density is quantized; another processor's sine may round some values differently.
        assert np.mean(voxels_of(written).values != voxels_of(committed).values) < 1e-3


@pytest.mark.parametrize("name", GROUPS)
def test_files_are_small(name):
    assert stage_of(name).stat().st_size < 1_500_000
    images = list((EXAMPLES / name).glob("*.png"))
    assert images and all(path.stat().st_size < 150_000 for path in images)


# The concert's groups are in the pictures of `test_beams_move_and_change_colour_while_the_set_stays`.
@pytest.mark.parametrize("name", sweep(GROUPS, ("forest",)))
def test_every_light_group_has_finite_beams(name):
    layers = rendered(opened(name))
    assert [layer for layer in layers if layer.startswith("beams_")] == [f"beams_{group}" for group in GROUPS[name]]
    for layer in ("surface", "beams", *(f"beams_{group}" for group in GROUPS[name])):
        assert np.all(np.isfinite(layers[layer])) and layers[layer].max() > 0, layer


# -- forest ----------------------------------------------------------------------------------------------------------

SUN = "/World/Light/Sun"
STILL = [
    "/World/Camera.xformOp:transform=((1,0,0,0),(0,1,0,0),(0,0,1,0),(0.3,1.45,0.6,1))",
    "/World/Light/Sky.photonbeams:enabled=0",
]


def test_leaves_hold_back_most_of_the_sun_and_make_shafts():
    shaded, bare, other = (
        rendered(opened("forest", *STILL, *more, beams=8192), passes=2, seed=seed)["beams"].sum(axis=2)
        for seed, more in ((0, []), (0, [f"{SUN}.photonbeams:gobo="]), (1, [f"{SUN}.photonbeams:gobo="]))
    )
    leaves = OpenImageIO.ImageBuf(str(EXAMPLES / "forest" / "leaves.png")).get_pixels(OpenImageIO.FLOAT)
    # The same trunks are in front of both suns, so the fraction of light that is left is that of the gaps between
    # leaves. The picture sees some gaps more than others: a factor of two either way.
    assert leaves.mean() / 2 < shaded.sum() / bare.sum() < 2 * leaves.mean() < 1

    # Leaves that held back the same fraction everywhere would make no shafts: only the noise between two seeds.
    rows, columns = (each // 4 for each in bare.shape)
    shaded, bare, other = (
        each[: 4 * rows, : 4 * columns].reshape(rows, 4, columns, 4).mean(axis=(1, 3)) for each in (shaded, bare, other)
    )
    lit = bare > 0.1 * bare.mean()
    shafts, noise = (each[lit] / bare[lit] for each in (shaded, other))
    assert shafts.std() / shafts.mean() > 1.5 * noise.std() / noise.mean()


def test_mist_drifts():
    """The mist drifts: beams and camera stand still, so only the noise of the look differs between two frames."""
    drifting = [rendered(opened("forest", *STILL), frame)["beams"] for frame in (1, 48)]
    calm = [
        rendered(opened("forest", *STILL, "/World/Looks/Shafts.photonbeams:noise:drift=(0,0,0)"), frame)["beams"]
        for frame in (1, 48)
    ]
    assert np.array_equal(*calm)
    assert np.abs(np.subtract(*drifting)).sum() > 0.05 * drifting[0].sum()


# -- concert ---------------------------------------------------------------------------------------------------------


def test_heads_and_lights_move_as_one_while_the_floor_stays():
    shot = pb.Shot.open(stage_of("concert"))
    first, later = (shot.read(frame)[0] for frame in (1, 20))
    meshes, moved = ({mesh.name: np.asarray(mesh.points) for mesh in each.meshes} for each in (first, later))
    for name, points in meshes.items():
        same = np.array_equal(points, moved[name])
        assert same != name.endswith(("/Can", "/Fork")), name
    turns = {}
    for before, after in zip(first.lights, later.lights, strict=True):
        if not before.emits_beams:
            continue
        can = before.name.replace("/Lamp", "/Can")
        for light, places in ((before, meshes), (after, moved)):
            # The lens is on the axis of the round can, 22 cm before the pivot; the can's middle is 1 cm behind it.
            toward = light.center - 0.5 * (places[can].min(axis=0) + places[can].max(axis=0))
            assert toward @ light.axis > 0.98 * np.linalg.norm(toward), before.name
        turns[before.name.split("/")[3]] = np.degrees(np.arccos(min(1.0, float(before.axis @ after.axis))))
    assert len(turns) == 10
    assert min(turns[name] for name in turns if name != "Key") > 3


def test_beams_move_and_change_colour_while_the_set_stays():
    still = "/World/Camera.xformOp:transform=((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2.5,9,1))"
    first, later = (rendered(opened("concert", still), frame) for frame in (1, 25))
    floor = first["depth"].shape[0] * 7 // 8  # the rows of the floor in front
    assert np.array_equal(first["depth"][floor:], later["depth"][floor:])
    assert np.abs(first["beams"] - later["beams"]).sum() > 0.3 * first["beams"].sum()
    share = [each["beams_floor"].sum(axis=(0, 1)) / each["beams_floor"].sum() for each in (first, later)]
    assert np.abs(share[0] - share[1]).max() > 0.02


@pytest.mark.soak  # in `make test`, the concert moves from frame to frame, and shutters have tests of their own
def test_motion_blur_is_on():
    shot = opened("concert", beams=16)
    camera = UsdGeom.Camera(shot.stage.GetPrimAtPath("/World/Camera"))
    assert camera.GetShutterCloseAttr().Get() - camera.GetShutterOpenAttr().Get() == 0.5
    sharp, blurred = (rendered(shot, 12, blur=blur)["beams_floor"] for blur in (False, True))
    assert np.abs(sharp - blurred).sum() > 0.05 * sharp.sum()


@pytest.mark.soak  # in `make test`, leaves before the sun of the forest hold back what their image says
def test_gobos_hold_back_light():
    heads = [f"/World/Rig/Back{k}/Yoke/Head/Lamp.photonbeams:gobo=" for k in range(1, 6)]
    dim, bright = (rendered(opened("concert", *more, beams=512))["beams_back"].sum() for more in ([], heads))
    images = (EXAMPLES / "concert" / f"{name}.png" for name in ("star", "bars", "breakup"))
    lit = [OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT).mean() for path in images]
    # The cone lights a circle of the square image, so the fraction of its light that passes is 4/π of the image's mean.
    # The edges of the cone and beams near the camera have other weights, which change it by less than a quarter.
    share = np.mean([lit[1], lit[2], lit[0], lit[2], lit[1]]) * 4 / np.pi
    assert 0.75 * share < dim / bright < min(1, 1.25 * share)


def test_hollow_looks_know_their_cone():
    """The expression's 0.0875 is the tangent of the cone's angle, so the hollow wall is at the edge of the cone."""
    stage = pb.Shot.open(stage_of("concert")).stage
    expression = stage.GetPrimAtPath("/World/Looks/Hollow").GetAttribute("photonbeams:across:expression").Get()
    tangent = float(re.search(r"([\d.]+) \* -Pl\.z", expression)[1])
    lamps = [prim for prim in stage.Traverse() if prim.GetName() == "Lamp"]
    hollow = [p for p in lamps if p.GetRelationship("photonbeams:look").GetTargets()[0].name == "Hollow"]
    assert len(hollow) == 4
    for prim in hollow:
        angle = prim.GetAttribute("inputs:shaping:cone:angle").Get()
        assert tangent == pytest.approx(np.tan(np.radians(angle)), abs=1e-4)


# -- smoke -----------------------------------------------------------------------------------------------------------


def test_smoke_has_a_grid_for_each_half_of_the_shutter_and_files_are_small():
    shot = pb.Shot.open(stage_of("smoke"))
    first, held, later = (shot.read(time)[0].media[0].grid.values for time in (0.75, 0.99, 1.2))
    assert held is first
    # The smoke drifts by less than a cell: the grids are similar, but not the same.
    assert 0.9 < np.corrcoef(first.ravel(), later.ravel())[0, 1] < 0.9999
    assert sum(path.stat().st_size for path in (EXAMPLES / "smoke").iterdir() if path.is_file()) < 500_000
