"""Files that Mitsuba scenes name: they are checked before Mitsuba opens them."""

import os
import re
import struct
import zlib
from types import MappingProxyType

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.images import files
from photonbeams.images.writing import write_png
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.world.checks import wrong_mesh
from photonbeams.world.plugin import world_of_plugin

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


def shared(times):
    """Return the dictionary of a scene that holds one more than 2 ** `times` times."""
    lobe = {"type": "diffuse"}
    for _ in range(times):
        lobe = {"type": "blendbsdf", "a": lobe, "b": lobe}
    return {"type": "scene", "ball": {"type": "sphere", "bsdf": lobe}}


def deep():
    """Return the dictionary of a scene that is too deep only where it holds a dictionary for the second time."""
    first = {"type": "diffuse"}
    for _ in range(150):
        first = {"type": "twosided", "own": first}
    second = first
    for _ in range(100):
        second = {"type": "twosided", "own": second}
    return {"type": "scene", "first": first, "second": second}


def loop():
    """Return the dictionary of a scene that holds itself."""
    scene = {"type": "scene"}
    scene["own"] = scene
    return scene


BALL = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap"}}}


@pytest.mark.parametrize(
    ("scene", "problem"),
    [
        ({"type": "scene", "ball": {**BALL, "bsdf": None}}, "ball.bsdf is None: expected a value, or leave it out"),
        ({"type": "scene", "ball": BALL}, "a bitmap reflectance names no file: expected a filename"),
        (shared(40), "holds 2.2e+12 dictionaries, each counted as often as it is held: expected up to 1,000,000"),
        (deep(), "holds objects in objects, more than 200 deep: expected fewer"),
        ({"type": 3}, "type is 3: expected text"),
        ({"type": "scene", "ball": {"type": ["sphere"]}}, "ball.type is ['sphere']: expected text"),
        ({"type": "scene", "ball": {"type": "ref", "id": 3}}, "ball.id is 3: expected text"),
        ({"type": "scene", "a\udc80": 1.0}, "a\\udc80 is not in UTF-8: expected text"),
        ({"type": "scene", "ball": {**BALL, "center": [0, None, 0]}}, "center is [0, None, 0]: expected no None in it"),
        (loop(), "holds objects in objects, more than 200 deep: expected fewer"),
        ({"type": "scene", "m": {"type": "obj", "filename": "/dev/zero"}}, "but it is a device"),
    ],
)
def test_dictionaries_that_mitsuba_would_crash_on_are_refused(scene, problem):
    with pytest.raises(SceneError) as error:
        pb.Shot(scene)
    assert str(error.value).startswith("a scene's dictionary: ") and str(error.value).endswith(problem)


def test_data_in_memory_that_mitsuba_would_crash_on_are_refused():
    mi = mitsuba()
    picture = mi.Bitmap(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, [4, 0])
    for kind, name, value, problem in (
        (
            "gridvolume",
            "data",
            mi.TensorXf(np.zeros((0, 1, 1, 1))),
            "is empty, of the shape (0, 1, 1, 1): expected one",
        ),
        (
            "gridvolume",
            "grid",
            mi.VolumeGrid(np.zeros((2, 3, 0, 1), np.float32)),
            "is empty, of the shape (0, 3, 2, 1)",
        ),
        ("bitmap", "bitmap", picture, "is empty, of the shape (4, 0, 3)"),
        ("envmap", "bitmap", picture, "is empty, of the shape (4, 0, 3)"),
        ("ellipsoids", "centers", mi.TensorXf(np.zeros(6)), "is of the shape (6,): expected a tensor with a row for"),
    ):
        with pytest.raises(SceneError, match=re.escape(f"own.{name} {problem}")):
            pb.Shot({"type": "scene", "own": {"type": kind, name: value}})


def test_a_mesh_in_memory_has_faces_wherever_a_dictionary_holds_it():
    group = {"type": "shapegroup", "own": mitsuba().Mesh("empty", 0, 0)}
    with pytest.raises(SceneError, match=r"group\.own is a mesh, but it has no faces: expected faces of its own"):
        pb.Shot({"type": "scene", "group": group})


def test_a_mark_before_a_comment_hides_nothing(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("# a triangle\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8-sig")
    assert pb.Shot({"type": "scene", "mesh": {"type": "obj", "filename": str(path)}, "eye": {"type": "perspective"}})


def test_names_of_files_and_dictionaries_in_a_scene_may_be_of_other_classes(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = MappingProxyType({"type": "obj", "filename": tmp_path / "a.obj"})
    assert len(pb.Shot({"type": "scene", "mesh": mesh}).subject.load().shapes()) == 1


def test_what_is_commented_out_is_not_named(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE % "<!-- <include filename='/dev/zero'/> -->")
    assert len(pb.Shot.open(tmp_path / "scene.xml").cameras()) == 1


PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n"
    b"property float x\nproperty list uchar int i\nend_header\n"
)


def test_meshes_are_as_long_as_they_say(tmp_path):
    packed = zlib.compress(struct.pack("<I", 0) + b"name\0" + struct.pack("<2Q", 1 << 40, 1))
    cut = zlib.compress(struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<2Q", 3, 1))
    meshes = {
        "png.ply": (b"\x89PNG\r\n\x1a\n" + bytes(99), "it is no PLY file"),
        "long.ply": (PLY % 4_000_000_000, "its header is of 20,000,000,000 bytes or more, but it has"),
        "text.ply": (b"ply\nformat ascii 1.0\nelement vertex 99999\nend_header\n", "its header is of 199,998 bytes"),
        "long.serialized": (struct.pack("<HH", 0x041C, 4) + packed, "its mesh of 1,099,511,627,776 vertices"),
        "png.serialized": (b"\x89PNG", "it is no serialized mesh"),
        "cut.serialized": (
            struct.pack("<HH", 0x041C, 4) + cut,
            "its mesh of 3 vertices and 1 triangles needs 70 bytes, but it has 22",
        ),
        "empty.obj": (b"", "it is empty"),
    }
    for name, (data, problem) in meshes.items():
        (tmp_path / name).write_bytes(data)
        text = refusal(tmp_path, SHAPE % (name.rpartition(".")[2], name))
        assert f"names {tmp_path / name}: expected a file that can be read, but {problem}" in text


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "<f4")


def ply(face, kind=b"binary_little_endian", order="<"):
    """Return a PLY file of a triangle with these corners."""
    axes = b"".join(b"property float %c\n" % each for each in b"xyz")
    head = b"ply\nformat %s 1.0\nelement vertex 3\n%selement face 1\n" % (kind, axes)
    head += b"property list uchar int vertex_indices\nend_header\n"
    if kind == b"ascii":
        return head + b"-1 -1 0\n1 -1 0\n0 1 0\n3 %d %d %d\n" % face
    return head + CORNERS.astype(f"{order}f4").tobytes() + struct.pack(f"{order}B3i", 3, *face)


def serialized(*faces, version=4, corners=CORNERS):
    """Return a file of Mitsuba's own with a mesh of one triangle for each face."""
    data, starts = b"", []
    for face in faces:
        starts.append(len(data))
        name = b"m\0" if version == 4 else b""
        head = struct.pack("<I", 0x1000) + name + struct.pack("<2Q", 3, 1)
        mesh = head + corners.tobytes() + struct.pack("<3I", *face)
        data += struct.pack("<HH", 0x041C, version) + zlib.compress(mesh)
    return data + struct.pack(f"<{len(starts)}{'Q' if version == 4 else 'I'}I", *starts, len(starts))


@pytest.mark.parametrize("last", [3, 1000, 1 << 24])
def test_faces_name_vertices_that_are_there(tmp_path, last):
    """Mitsuba reads memory beyond a mesh, or ends the process."""
    face = (0, 1, last)
    meshes = {
        "binary.ply": ply(face),
        "big.ply": ply(face, b"binary_big_endian", ">"),
        "text.ply": ply(face, b"ascii"),
        "one.serialized": serialized((0, 1, last)),
        "old.serialized": serialized((0, 1, last), version=3),
    }
    for name, data in meshes.items():
        (tmp_path / name).write_bytes(data)
        text = refusal(tmp_path, SHAPE % (name.rpartition(".")[2], name))
        assert f"names {tmp_path / name}: expected a file that can be read, but a face names vertex" in text, text


def test_a_mesh_has_faces_and_finite_vertices(tmp_path):
    """Mitsuba leaves out faces of OBJ files that it cannot read, and traces no ray in a scene with an empty mesh."""
    meshes = {
        "a.obj": (b"v 0 0 0\nv 1 0 0\nvn 0 0 1\nf 1//1 2//1\n", "it has no faces"),
        "a.ply": (ply((0, 1, 2)).replace(b"face 1", b"face 0")[:-13], "it has no faces"),
        "a.serialized": (serialized((0, 1, 2), corners=CORNERS * np.float32(np.nan)), "a vertex is not finite"),
    }
    for name, (data, problem) in meshes.items():
        (tmp_path / name).write_bytes(data)
        text = refusal(tmp_path, SHAPE % (name[2:], name))
        assert f"names {tmp_path / name}: expected a file that can be read, but {problem}" in text


def test_no_face_names_a_vertex_below_0_or_is_left_out(tmp_path):
    """Mitsuba takes a vertex below 0 of a PLY file for the first one, and leaves out faces that it cannot read."""
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
    meshes = {
        "little.ply": (ply((-1, 1, 2)), "a face names vertex -1: expected 0 or more"),
        "big.ply": (ply((0, -7, 2), b"binary_big_endian", ">"), "a face names vertex -7"),
        "text.ply": (ply((0, 1, -1), b"ascii"), "a face names vertex -1"),
        "name.obj": (corners + b"f x 1 2\nf 1 2 3\n", "Mitsuba finds 1 of its 2 triangles: expected corners such as"),
        "mark.obj": (b"\xef\xbb\xbf" + corners + b"f 1 2 3\n", "its first line begins with a byte order mark"),
        "lines.obj": (corners + b"f 1 2 3 \\\n4\n", "Mitsuba finds 1 of its 2 triangles"),
    }
    for name, (data, problem) in meshes.items():
        (tmp_path / name).write_bytes(data)
        assert problem in refusal(tmp_path, SHAPE % (name.rpartition(".")[2], name))


@pytest.mark.parametrize("line", ["f 1 2 3", "\tf 1// 2 4 3 # a quad", "f 1 2 4 3\r", "#f x\ng f\nf 1 2 3"])
def test_faces_of_any_spelling_are_read(tmp_path, line):
    (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n{line}\n")
    (tmp_path / "scene.xml").write_text(SCENE % (SHAPE % ("obj", "a.obj")))
    assert len(pb.Shot.open(tmp_path / "scene.xml").cameras()) == 1


def test_what_mitsuba_says_of_a_scene_is_logged_once_in_plain_text(tmp_path, caplog, capfd):
    sampler = '<sampler type="stratified"><integer name="sample_count" value="5"/></sampler>'
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective">{sampler}</sensor></scene>')
    pb.Shot.open(path).subject.load()
    (told,) = [each.getMessage() for each in caplog.records]
    assert told == f"{path}: [StratifiedSampler] Sample count should be square and power of two, rounding to 9"
    assert "Sampler" not in "".join(capfd.readouterr())


def test_the_mesh_that_is_named_is_checked(tmp_path):
    (tmp_path / "two.serialized").write_bytes(serialized((0, 1, 2), (0, 1, 3)))
    shape = (SHAPE % ("serialized", "two.serialized")).replace("/></", '/><integer name="shape_index" value="%d"/></')
    (tmp_path / "scene.xml").write_text(SCENE % (shape % 0))
    assert len(pb.Shot.open(tmp_path / "scene.xml").cameras()) == 1
    assert "a face names vertex 3 of a mesh that has 3" in refusal(tmp_path, shape % 1)
    assert "it has 2 meshes: expected one with the number 2" in refusal(tmp_path, shape % 2)


@pytest.mark.parametrize("count", ["-1", "nan", "1e9", "\xb2", "", "99999999999999999999"])
def test_counts_of_meshes_are_whole_numbers(tmp_path, count):
    data = ply((0, 1, 2)).replace(b"vertex 3", b"vertex " + count.encode("latin-1"))
    (tmp_path / "a.ply").write_bytes(data)
    assert "expected a file that can be read, but its header" in refusal(tmp_path, SHAPE % ("ply", "a.ply"))


def test_a_scene_in_memory_has_faces_of_its_own_vertices():
    mi = mitsuba()
    assert wrong_mesh(mi.load_dict({"type": "cube"})) == ""
    scene = mi.load_dict({"type": "scene", "a": {"type": "cube", "id": "box"}, "light": {"type": "constant"}})
    parameters = mi.traverse(scene)
    key = next(each for each in parameters.keys() if each.endswith("faces"))  # noqa: SIM118 (it is no mapping)
    parameters[key] = type(parameters[key])([*np.asarray(parameters[key])[:-1], 99])
    assert wrong_mesh(scene.shapes()[0]) == "a face names vertex 99 of a mesh that has 24"
    with pytest.raises(SceneError, match="a face names vertex 99 of a mesh that has 24: expected faces of its own"):
        world_of_plugin(scene)


DIFFUSE = '<bsdf type="diffuse"/>'


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ('<bsdf type="twosided">' * 8000 + "</bsdf>" * 8000, "nests elements more than 200 deep"),
        ('<bsdf type="twosided" id="/>">' * 8000 + "</bsdf>" * 8000, "nests elements more than 200 deep"),
        (
            "".join(f'<bsdf type="mask" id="b{k}"><ref id="b{k + 1}"/></bsdf>' for k in range(300)),
            "holds objects in objects, more than 200 deep",
        ),
        # Mitsuba gives each side of a two-sided BSDF all parts of those in it: 2^40 of them.
        ('<bsdf type="twosided">' * 40 + DIFFUSE + "</bsdf>" * 40, "a bsdf holds others, 1.1e+12 in all"),
    ],
)
def test_objects_are_not_too_deep_in_objects(tmp_path, content, problem):
    assert problem in refusal(tmp_path, content)
    (tmp_path / "inner.xml").write_text(SCENE % content)
    assert problem in refusal(tmp_path, '<include filename="inner.xml"/>')


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
