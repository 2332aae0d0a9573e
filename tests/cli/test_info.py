"""`photonbeams info` says what a file holds, in lines that can be searched."""

import re
import struct
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from examples.vdb import write_vdb
from photonbeams.cli import main
from photonbeams.cli.info import info
from photonbeams.scene import SceneError
from tests.helpers.frames import write_frame

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
GUIDE = EXAMPLES.parent / "docs" / "guide.md"


def masked(text):
    """Return a text with its numbers masked, which differ a little from machine to machine, and single spaces."""
    return re.sub(r"-?\d[\d.]*", "#", " ".join(text.split()))


def lines(capsys, path):
    info(path)
    return [re.sub(r"\s+", " ", line).strip() for line in capsys.readouterr().out.splitlines()]


def test_text_of_a_binary_layer_that_is_no_utf8_is_an_error(tmp_path, capsys):
    from pxr import Sdf

    layer = Sdf.Layer.CreateNew(str(tmp_path / "a.usdc"))
    layer.documentation = "a cafe of Paris"
    Sdf.CreatePrimInLayer(layer, "/Bar").typeName = "Cube"
    layer.Save()
    for word, bad in ((b"cafe", b"caf\xe9"), (b"Cube", b"C\xffbe")):
        (tmp_path / "b.usdc").write_bytes((tmp_path / "a.usdc").read_bytes().replace(word, bad))
        with pytest.raises(SystemExit, match="1"):
            main(["info", str(tmp_path / "b.usdc")])
        error, text = capsys.readouterr().err, bad.decode(errors="replace")
        assert re.fullmatch(rf"Error: .*b\.usdc has the text '.*{text}.*': expected UTF-8\n", error)


def test_an_exr_shows_its_layers_ranges_and_headers(tmp_path, capsys):
    rgba = np.full((6, 8, 4), 0.5, np.float32)
    rgba[1, 2] = np.nan, 2.0, 0.5, 1.0
    depth = np.full((6, 8), 3.0)
    depth[0] = np.inf
    metadata = {"framesPerSecond": Fraction(24), "seed": 7, "worldToCamera": np.eye(4)}
    write_frame(tmp_path / "a.exr", {"depth": depth, "rgba": rgba}, metadata)
    found = lines(capsys, tmp_path / "a.exr")
    mean = (0.5 * (6 * 8 * 4 - 3) + 3.0) / (6 * 8 * 4 - 1)  # all are 0.5, except for a NaN, a 2 and a 1
    assert f"rgba RGBA half 8 x 6 0.5 {mean:.5g} 2 1 0" in found
    assert "depth Z float 8 x 6 3 3 3 0 8" in found
    assert "seed 7" in found
    assert "framesPerSecond 24" in found
    assert "worldToCamera 1 0 0 0" in found


def test_a_stereo_exr_shows_the_view_of_each_layer_and_what_its_views_do_not_share(tmp_path, capsys):
    views = {
        view: (
            {"depth": np.full((6, 8), value), "rgba": np.full((6, 8, 4), value)},
            {"seed": 7, "camera": f"/Rig/{view}", "worldToCamera": value * np.eye(4)},
        )
        for view, value in (("left", 0.5), ("right", 2.0))
    }
    write_frame(tmp_path / "a.exr", {}, views=views)
    found = lines(capsys, tmp_path / "a.exr")
    assert found[0] == "layer view channels type size min mean max NaN infinite"
    assert found[1:5] == [
        "rgba left RGBA half 8 x 6 0.5 0.5 0.5 0 0",
        "depth left Z float 8 x 6 0.5 0.5 0.5 0 0",
        "rgba right RGBA half 8 x 6 2 2 2 0 0",
        "depth right Z float 8 x 6 2 2 2 0 0",
    ]
    assert found.count("seed 7") == 1
    assert {"camera left /Rig/left", "camera right /Rig/right"} <= set(found)
    assert {"worldToCamera left 0.5 0 0 0", "worldToCamera right 2 0 0 0"} <= set(found)


def test_a_png_shows_its_size_and_type(tmp_path, capsys):
    write_frame(tmp_path / "a.png", {"rgba": np.zeros((6, 8, 4))})
    assert "rgba RGB uint8 8 x 6 0 0 0 0 0" in lines(capsys, tmp_path / "a.png")


def test_a_layer_of_nothing_finite_has_no_range(tmp_path, capsys):
    write_frame(tmp_path / "a.exr", {"rgba": np.zeros((2, 3, 4)), "depth": np.full((2, 3, 1), np.nan)})
    assert "depth Z float 3 x 2 - - - 6 0" in lines(capsys, tmp_path / "a.exr")


def test_the_keyhole_stage_shows_all_that_a_render_needs(capsys):
    found = "\n".join(lines(capsys, EXAMPLES / "keyhole" / "keyhole.usda"))
    for pattern in (
        r"^up axis Y$",
        r"^unit 1 m$",
        r"^frames 1 to 101, 24 a second$",
        r"^fog scattering [\d.]",
        r"^half of a shaft's light is left after 5\.33 or 4\.95 or 4\.62 units \(m\) \(by colour\) of it$",
        r"^of what /World/Camera sees, about 3\.\d+ units \(m\) away, 6\d % 6\d % 6\d % of the light is left$",
        r"^/World/Camera 32 mm on 36 mm 58\.7 degrees wide no blur all sharp x 1 ",
        r"^/World/Flight 28 mm on 36 mm 65\.5 degrees wide -0\.25 to 0\.25 frames f/4 at 2\.5 x 1 ",
        r"^/World/Light/Key rect .* key 4,096.* /World/Portal /World/Looks/Keyhole$",
        r"^/World/Light/Fill dome .* none$",
        r"^/World/Light/Key lights 2\.\d % of what /World/Camera sees; white paper there shows [\d.]+ \(1 is white\)$",
        r"^all of its light gets into fog, of which /World/Camera sees 6\d %, /World/Flight sees 6\d %$",
        r"^/World/Door/… 5 2,708 4,172 2 materials$",
        r"^/World/Chamber 1 [\d,]+ [\d,]+ [\d. ]+$",
        r"^lamps light 3\d % of what /World/Camera sees, and nothing lights the rest --bounces 3$",
        r"^/World/Looks/Keyhole physical x ramp of \d epanechnikov physical physical$",
    ):
        assert re.search(pattern, found, re.MULTILINE), pattern
    assert not re.search(r"^/World/Portal", found, re.MULTILINE)  # a portal is not listed as a mesh


def test_a_stage_from_blender_says_what_it_lacks_and_what_to_type(capsys, monkeypatch):
    monkeypatch.chdir(EXAMPLES.parent)
    found = lines(capsys, EXAMPLES / "blender" / "attic.usda")
    assert "fog none" in found
    assert "frames no range, 24 a second" in found
    assert "up axis Z" in found
    assert "/Attic/CrateSmall/… 13 1,176 540 2 materials" in found
    assert sum(line.startswith(("/Attic/", "and others ")) for line in found) < 20  # of 90 meshes, and all lights
    assert re.search(r"^/Attic/Spot/Spot sphere [\d. e+]+ 4,096$", "\n".join(found), re.MULTILINE)
    opening = next(line for line in found if line.startswith("comes in through an opening"))
    middle = [float(each) for each in opening.rpartition(" at ")[2].split()]
    assert np.allclose(middle, (-0.585, 0.25, 2.515), atol=0.1)  # that of the skylight, which the guide's layer names
    assert "there is no fog, so no shaft shows --scattering 0.05" in found
    assert "or, for good: photonbeams dress examples/blender/attic.usda -o attic_beams.usda" in found
    shown = re.findall(
        r"^    (.+)$", GUIDE.read_text().partition("## See what is there")[2].partition("## First")[0], re.M
    )
    assert len(shown) == 9
    for line in shown:  # of the guide, but for digits
        assert any(masked(line) in masked(each) for each in found) or line == "…", line


AWAY = """{{
    double3 xformOp:translate = (0, 0, {z})
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {more}
}}
"""
CAMERA, FOG = 'def Camera "C" {\n}\n', 'def Scope "Fog" {\n color3f photonbeams:scattering = (9, 9, 9)\n}\n'
HIDDEN, BLACK, WEAK, PLAIN = (
    f"{{\n {each}\n}}\n"
    for each in ('token visibility = "invisible"', "float inputs:intensity = 0", "float inputs:intensity = 1", "")
)
IN_A_BOX = f'{AWAY.format(z=50, more="")}def Cube "Box" {AWAY.format(z=50, more="double size = 4")}'
WALL = f'def Cube "Box" {AWAY.format(z=-9, more="")}'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the stage has no camera"),
        (CAMERA, "the stage has no light"),
        (f'{CAMERA}def SphereLight "L" {HIDDEN}', r"all lights are hidden --set /L\.visibility=inherited"),
        (f'{CAMERA}def SphereLight "L" {BLACK}', r"/L is black --set /L\.inputs:intensity=1"),
        (f'{CAMERA}def DomeLight "Sky" {PLAIN}{WALL}', "no light makes beams --dome-beams"),
        (f'{CAMERA}def SphereLight "L" {IN_A_BOX}', "no camera sees fog that /L lights"),
        (f'{CAMERA}{FOG}{WALL}def SphereLight "L" {PLAIN}',
         r"the fog is thick: hardly any is left .* --set /Fog\.photonbeams:scattering=0\.03"),
        (f'{CAMERA}{WALL}def DistantLight "L" {WEAK}', r"what /C sees is dark for a screen --exposure 1\d"),
    ],
    ids=("camera", "light", "hidden", "black", "dome", "shut", "thick", "dim"),
)  # fmt: skip
def test_why_a_picture_would_be_dark(tmp_path, capsys, text, reason):
    (tmp_path / "a.usda").write_text(f"#usda 1.0\n{text}")
    found = "\n".join(lines(capsys, tmp_path / "a.usda"))
    assert re.search(rf"^{reason}", found.partition("why it would be dark")[2], re.MULTILINE)


def test_fog_that_varies_is_described_and_not_called_thick(tmp_path, capsys):
    names = ("height:falloff = 2", "height:ground = 1", "noise:amount = 1", "noise:scale = 3")
    fog = FOG.replace("}", "".join(f" float photonbeams:{name}\n" for name in names) + "}")
    (tmp_path / "a.usda").write_text(f"#usda 1.0\n{CAMERA}{fog}{WALL}")
    found = lines(capsys, tmp_path / "a.usda")
    assert "falls to 1 / e over 2 above the height 1 and has wisps of up to 3 units" in found
    assert not any("thick" in line for line in found)


def test_lights_that_are_hidden_at_first_are_told(tmp_path, capsys):
    (tmp_path / "a.usda").write_text(
        """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 4
)
def Xform "G" {
    token visibility.timeSamples = { 1: "invisible", 3: "inherited" }
    def SphereLight "Key" {
    }
}
def SphereLight "Fill" {
}
"""
    )
    found = lines(capsys, tmp_path / "a.usda")
    assert "/G/Key hidden at first none yet" in found
    assert sum(line.startswith("/Fill sphere ") for line in found) == 1


def test_what_is_neither_stage_nor_image_is_named(tmp_path):
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(SceneError, match=r"a\.txt cannot be read: expected an image"):
        info(tmp_path / "a.txt")
    with pytest.raises(FileNotFoundError):
        info(tmp_path / "b.exr")


def test_a_volume_file_shows_its_grids(tmp_path, capsys):
    values = np.zeros((4, 5, 6), np.float32)
    values[1:3, 1:4, 1:5] = np.linspace(0.25, 2, 24).reshape(2, 3, 4)
    write_vdb(tmp_path / "smoke.vdb", {"density": values, "Cd": np.ones((2, 2, 2, 3))}, np.diag([3, 2.5, 2, 1]))
    found = lines(capsys, tmp_path / "smoke.vdb")
    assert found[0] == "grid type class voxels box from voxel size range dense compression"
    assert found[1] == "density float, half fog volume 24 4 x 3 x 2 1 1 1 0.5 0.25 to 2 0.1 kB zip, active voxels"
    assert found[2].startswith("Cd vec3s, half fog volume 8 2 x 2 x 2 0 0 0 1.5 1.25 1 1 to 1")
    header = struct.pack("<3sB5i6f", b"VOL", 3, 1, 2, 1, 1, 1, -1, 0, 0, 1, 1, 1)
    (tmp_path / "smoke.vol").write_bytes(header + np.array([1, 3], "<f4").tobytes())
    assert lines(capsys, tmp_path / "smoke.vol")[1] == "float 2 2 x 1 x 1 -1 0 0 1 1 to 3 0.0 kB none"
    (tmp_path / "smoke.vdb").write_bytes(b"x" * 99)
    with pytest.raises(SceneError, match=r"smoke\.vdb: expected a grid that can be read, but it is no OpenVDB file"):
        info(tmp_path / "smoke.vdb")


def test_names_in_files_give_no_commands_to_a_terminal(tmp_path, capsys):
    name = "a\x1b[31m"
    write_vdb(tmp_path / f"{name}.vdb", {name: np.ones((4, 4, 4), np.float32)})
    (tmp_path / f"{name}.usda").write_text('#usda 1.0\ndef "A" { float[] a\x1b]0;b\x07 = [0] }')
    info(tmp_path / f"{name}.vdb")
    for arguments in (["info", f"{tmp_path / name}.usda"], ["info", "--no-such-flag\x1b[31m"], ["info", f"{name}.exr"]):
        with pytest.raises(SystemExit):
            main(arguments)
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err and r"a\x1b[31m" in out and r"a\x1b]0;b\x07" in err and err.count("Error: ") == 3
