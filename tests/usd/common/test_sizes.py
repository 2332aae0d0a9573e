"""Stages that do not fit into memory are thinned out, or refused, before they are expanded."""

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
    monkeypatch.setattr(instancers, "room", lambda: 4 * (sizes.MESH + 6))
    assert [mesh.name for mesh in read_scene(stage).meshes] == [f"/Copies[{index}]" for index in (0, 2, 4, 6)]
    assert "/Copies.protoIndices has 8 instances: one in 2 is rendered, to limit memory" in caplog.text
    monkeypatch.setattr(meshes, "room", lambda: 5)
    assert len(read_scene(stage).meshes) == 2
    assert "more triangles than fit into memory" in caplog.text
    monkeypatch.setattr(instancers, "MOST_INSTANCES", 7)
    assert not read_scene(stage).meshes
    assert "has 8 values: expected no more than 7" in caplog.text


def test_instancers_of_instancers_are_counted_before_they_are_expanded(usd, caplog):
    """Nine nested instancers of ten copies each count as 10^9 instances."""
    tens = f"int[] protoIndices = {[0] * 10}\npoint3f[] positions = [{', '.join(['(0, 0, 0)'] * 10)}]"
    text = 'def Cube "Leaf" {}\n'
    for level in range(1, 10):
        inner = "/Leaf" if level == 1 else f"/I{level - 1}"
        text += f'def PointInstancer "I{level}" {{\n{tens}\nrel prototypes = <{inner}>\n}}\n'
    stage = usd(text)
    reading = instancers.Reading(stage)
    copies = instancers._triangles_in(reading, stage.GetPrimAtPath("/I9"), ())
    assert copies == 10**9 * (sizes.MESH + sizes.triangles_about(reading, stage.GetPrimAtPath("/Leaf")))
