"""Files that Mitsuba scenes name: they are checked before Mitsuba opens them."""

import os
import struct
import zlib

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.images import files
from photonbeams.images.writing import write_png
from photonbeams.scene import SceneError

SCENE = '<scene version="3.0.0">%s<default name="own" value="a file"/><sensor type="perspective"/></scene>'
SHAPE = '<shape type="%s"><string name="filename" value="%s"/></shape>'
TEXTURE = '<texture type="bitmap" id="t"><string name="filename" value="%s"/></texture>'

# Everywhere that a scene may name a file; %s is the name.
PLACES = (
    *(SHAPE % (kind, "%s") for kind in ("ply", "obj", "serialized")), TEXTURE, '<include filename="%s"/>',
    '<emitter type="point"><spectrum name="intensity" filename="%s"/></emitter>',
    "<emitter type='envmap'><string name='filename' value='%s'/></emitter>",
    '<default name="x" value="%s"/><shape type="ply"><string name="filename" value="$x"/></shape>',
    '<path value="sub"/><shape type="ply"><string name="filename" value="%s"/></shape>',
)  # fmt: skip


def refusal(tmp_path, content, text=SCENE):
    """Return the message for a scene, which must be one sentence."""
    path = tmp_path / "scene.xml"
    path.write_text(text % content)
    with pytest.raises(SceneError) as error:
        pb.Shot.open(path)
    assert str(error.value).startswith(str(path))
    return str(error.value)


@pytest.mark.parametrize("place", PLACES)
def test_pipes_and_devices_are_refused_wherever_a_scene_names_them(tmp_path, place):
    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "sub" / "pipe.png")
    for name, problem in (("sub/pipe.png", "a named pipe"), ("/dev/zero", "a device")):
        assert f"expected a file, but it is {problem}" in refusal(tmp_path, place % name)


def test_an_included_file_is_looked_into(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "a.xml").write_text(SCENE % (SHAPE % ("ply", "pipe")))
    assert "names pipe: expected a file, but it is a named pipe" in refusal(tmp_path, '<include filename="a.xml"/>')
    assert "includes" in refusal(tmp_path, '<include filename="scene.xml"/>')


def test_what_is_commented_out_is_not_named(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE % "<!-- <include filename='/dev/zero'/> -->")
    assert len(pb.Shot.open(tmp_path / "scene.xml").cameras()) == 1


PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n"
    b"property float x\nproperty list uchar int i\nend_header\n"
)


def test_meshes_are_as_long_as_they_say(tmp_path):
    packed = zlib.compress(struct.pack("<I", 0) + b"name\0" + struct.pack("<2Q", 1 << 40, 1))
    meshes = {
        "png.ply": (b"\x89PNG\r\n\x1a\n" + bytes(99), "it is no PLY file"),
        "long.ply": (PLY % 4_000_000_000, "its header is of 20,000,000,000 bytes or more, but it has"),
        "text.ply": (b"ply\nformat ascii 1.0\nelement vertex 99999\nend_header\n", "its header is of 199,998 bytes"),
        "long.serialized": (struct.pack("<HH", 0x041C, 4) + packed, "its mesh of 1,099,511,627,776 vertices"),
        "png.serialized": (b"\x89PNG", "it is no serialized mesh"),
        "empty.obj": (b"", "it is empty"),
    }
    for name, (data, problem) in meshes.items():
        (tmp_path / name).write_bytes(data)
        text = refusal(tmp_path, SHAPE % (name.rpartition(".")[2], name))
        assert f"names {tmp_path / name}: expected a file that can be read, but {problem}" in text


def test_images_have_as_many_pixels_as_can_be_read(tmp_path, monkeypatch):
    write_png(tmp_path / "a.png", np.zeros((6, 8, 3)))
    monkeypatch.setattr(files, "MOST_PIXELS", 47)
    problem = "it has 8 x 6 pixels, which are more than 47"
    assert problem in refusal(tmp_path, TEXTURE % "a.png")
    for read in (files.read_parts, files.summaries, files.read_image):
        with pytest.raises(SceneError, match=problem):
            read(tmp_path / "a.png")


def test_a_bitmap_without_a_file_does_not_end_the_process(tmp_path):
    assert "a bitmap t names no file" in refusal(tmp_path, '<texture type="bitmap" id="t"/>')


def test_bytes_that_are_no_text_are_quoted_in_a_sentence(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_bytes((SCENE % "<shape type='x\xff'/>").encode("latin-1"))
    with pytest.raises(SceneError, match=r"scene\.xml: "):
        pb.Shot.open(path)
