"""Stages that do not fit into memory are thinned out, or refused, before they are expanded."""

import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.common import sizes
from photonbeams.usd.common.sizes import lowered, step_of
from photonbeams.usd.geometry import instancers, meshes
from photonbeams.usd.stage import read_scene

CUBES = """def PointInstancer "Copies" {
    rel prototypes = [</Copies/Cube>]
    int[] protoIndices = [0, 0, 0, 0, 0, 0, 0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0), (5, 0, 0), (6, 0, 0), (7, 0, 0)]
    def Mesh "Cube" {
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 1]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    }
}
"""


def test_one_of_so_many_parts_is_kept_that_the_rest_fits():
    assert [step_of(total, 100) for total in (0, 100, 101, 1000)] == [1, 1, 2, 10]
    assert step_of(5, 0) == 5


def test_the_level_of_subdivision_is_what_fits():
    # n corners become n quads at level 1, 4 n at level 2 and 16 n at level 3, of two triangles each.
    assert [lowered(3, 10, left) for left in (19, 20, 80, 319, 320, 10**9)] == [0, 1, 2, 2, 3, 3]


def test_instancers_are_thinned_out_to_what_memory_holds(usd, monkeypatch, caplog):
    stage = usd(CUBES)
    monkeypatch.setattr(instancers, "room", lambda: 4 * (sizes.MESH + 2))
    assert [mesh.name for mesh in read_scene(stage).meshes] == [f"/Copies[{index}]" for index in (0, 2, 4, 6)]
    assert "/Copies.protoIndices has 8 instances: one in 2 is rendered, to limit memory" in caplog.text
    monkeypatch.setattr(meshes, "room", lambda: 5)
    assert len(read_scene(stage).meshes) == 2
    assert "more triangles than fit into memory" in caplog.text
    monkeypatch.setattr(instancers, "MOST_INSTANCES", 7)
    assert not read_scene(stage).meshes
    assert "has 8 values: expected no more than 7" in caplog.text


def nested(levels, leaf="Cube"):
    """Return instancers of ten copies in each other, so many, the outermost of which is alone on the stage."""
    tens = f"int[] protoIndices = {[0] * 10}\npoint3f[] positions = [{', '.join(['(0, 0, 0)'] * 10)}]"
    text = f'class "Parts" {{\ndef {leaf} "I0" {{}}\n'
    for level in range(1, levels):
        text += f'def PointInstancer "I{level}" {{\n{tens}\nrel prototypes = </Parts/I{level - 1}>\n}}\n'
    return text + f'}}\ndef PointInstancer "All" {{\n{tens}\nrel prototypes = </Parts/I{levels - 1}>\n}}'


def test_an_even_selection_of_nested_instances_is_rendered(usd, monkeypatch, caplog):
    """Of the 1,000 copies, numbered from 0, every 40th is rendered: 0, 40, 80 and so on to 960."""
    monkeypatch.setattr(instancers, "room", lambda: 25 * (sizes.MESH + 12))
    names = [mesh.name for mesh in read_scene(usd(nested(3))).meshes]
    numbers = [f"{number:03d}" for number in range(0, 1000, 40)]
    assert names == [f"/All[{a}][{b}][{c}]" for a, b, c in numbers]
    assert "/All.protoIndices has 1,000 instances: one in 40 is rendered, to limit memory" in caplog.text


def test_a_prototype_is_rendered_whole_or_not_at_all(usd, monkeypatch):
    monkeypatch.setattr(instancers, "room", lambda: 10 * (sizes.MESH + 12))
    stage = usd(nested(2).replace('def Cube "I0" {}', 'def Xform "I0" {\ndef Cube "a" {}\ndef Cube "b" {}\n}'))
    names = [mesh.name for mesh in read_scene(stage).meshes]
    assert names == [f"/All[{each}][0]/{part}" for each in (0, 2, 4, 6, 8) for part in "ab"]


@pytest.mark.parametrize("levels", [8, 12, 30])
def test_instances_without_end_are_refused(usd, levels):
    """Twelve nested instancers of ten copies each make 10^12; 30 make more than numbers of 64 bits hold."""
    text = "/All.protoIndices makes more than 10,000,000 copies with those of instancers that it repeats"
    with pytest.raises(SceneError, match=text):
        read_scene(usd(nested(levels)))


@pytest.mark.parametrize(
    "text",
    [
        'def Cube "A" {}', 'def Plane "A" {}', 'def Sphere "A" {}', 'def Cone "A" {}', 'def Capsule "A" {}',
        CUBES[CUBES.index("def Mesh"):].rpartition("}")[0].replace("Cube", "A"),
    ],
)  # fmt: skip
def test_triangles_are_counted_as_they_will_be_made(usd, text):
    stage = usd(text)
    made = sum(len(mesh.faces) for mesh in read_scene(stage).meshes)
    counted = meshes.triangle_count(instancers.Reading(stage), stage.GetPrimAtPath("/A"))
    # At the poles of a surface of revolution, a triangle of each of up to two rings of 64 quads has no area.
    assert made <= counted <= made + 2 * 64


def test_subdivided_meshes_are_counted_as_they_will_be_made(usd):
    text = CUBES[CUBES.index("def Mesh") :].rpartition("}")[0].replace("Cube", "A")
    scheme = 'uniform token subdivisionScheme = "catmullClark"'
    stage = usd(text.replace("int[] faceVertexCounts", f"{scheme}\nint[] faceVertexCounts"))
    made = sum(len(mesh.faces) for mesh in read_scene(stage).meshes)
    assert meshes.triangle_count(instancers.Reading(stage), stage.GetPrimAtPath("/A")) == made == 2 * 6 * 4


def test_ten_thousand_cubes_are_all_counted_as_twelve_triangles(usd):
    """They once counted as 4,096 each, and every second one was dropped on a machine of 23 GB."""
    reading = instancers.Reading(usd(nested(4)))
    copies = instancers._copies(reading, reading.stage.GetPrimAtPath("/All"), ())
    assert (copies.count, copies.triangles) == (10_000, 10_000 * (sizes.MESH + 12))
