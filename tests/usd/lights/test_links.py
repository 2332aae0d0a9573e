"""Light linking: what a light's collections leave out."""

import pytest

from photonbeams.scene import Scene

MESH = """
    def Mesh "%s" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]%s
    }
"""
SUBSET = """
        def GeomSubset "Half" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </Paint>
        }"""
STAGE = (
    'def Xform "A" {' + MESH % ("One", "") + MESH % ("Two", "") + "}\n"
    'def Xform "B" {' + MESH % ("Three", SUBSET) + "}\n"
    'def Material "Paint" {\n}\n'
    """
def PointInstancer "Many" {
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    rel prototypes = </Many/Prototype>
"""
    + MESH % ("Prototype", "")
    + """
}
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
"""
)
ALL = {"/A/One", "/A/Two", "/B/Three/Half", "/Many[0]", "/Many[1]"}


@pytest.fixture
def light(scene):
    """Return a function that reads the stage with a light whose collections are given."""

    def read(body=""):
        found: Scene = scene(f'{STAGE}def SphereLight "L" {{\n{body}\n}}')
        assert {mesh.name for mesh in found.meshes} == ALL
        return found.lights[0]

    return read


def test_without_links_a_light_reaches_everything(light):
    found = light()
    assert (found.unlit, found.unshadowed, found.emits_beams) == (frozenset(), frozenset(), True)


@pytest.mark.parametrize("kind", ["lightLink", "shadowLink"])
def test_what_a_link_excludes_is_left_out_with_all_below_it(light, kind, caplog):
    found = light(f"rel collection:{kind}:excludes = [</A>, </Many>]")
    left_out, other = (found.unlit, found.unshadowed) if kind == "lightLink" else (found.unshadowed, found.unlit)
    assert left_out == {"/A/One", "/A/Two", "/Many[0]", "/Many[1]"}
    assert other == frozenset()
    assert found.emits_beams
    assert "Link" not in caplog.text


def test_a_link_that_includes_some_leaves_out_the_rest_and_so_the_fog(light):
    root = "bool collection:lightLink:includeRoot = 0"
    found = light(f"{root}\nrel collection:lightLink:includes = [</A>, </B/Three>]\n"
                  "rel collection:lightLink:excludes = </A/Two>")  # fmt: skip
    assert found.unlit == {"/A/Two", "/Many[0]", "/Many[1]"}
    assert not found.emits_beams
    assert light(f"{root}\nrel collection:lightLink:includes = [</A>, </Fog>]").emits_beams
    assert light(root).unlit == ALL


@pytest.mark.parametrize("includes, text", [
    ("</Gone>", "/L.collection:lightLink:includes names /Gone, which is not there: the light lights neither"),
    ("[]", "/L.collection:lightLink includes nothing that is rendered: the light lights neither"),
])  # fmt: skip
def test_a_link_that_leaves_the_light_nothing_is_named(light, includes, text, caplog):
    light(f"bool collection:lightLink:includeRoot = 0\nrel collection:lightLink:includes = {includes}")
    assert text in caplog.text


def test_a_collection_in_a_circle_prints_nothing_of_openusd(light, capfd):
    light("""bool collection:lightLink:includeRoot = 0
        rel collection:lightLink:includes = [</A>, </L.collection:more>]
        uniform token collection:more:expansionRule = "expandPrims"
        rel collection:more:includes = </L.collection:lightLink>""")
    assert "_ComputeMembership" not in capfd.readouterr().err


@pytest.mark.parametrize("kind", ["lightLink", "shadowLink"])
def test_a_link_that_names_a_prototype_counts_for_its_copies(light, kind):
    found = light(f"rel collection:{kind}:excludes = </Many/Prototype>")
    assert (found.unlit if kind == "lightLink" else found.unshadowed) == {"/Many[0]", "/Many[1]"}
    root = f"bool collection:{kind}:includeRoot = 0\nrel collection:{kind}:includes"
    found = light(f"{root} = </Many>\nrel collection:{kind}:excludes = </Many/Prototype>")
    assert (found.unlit if kind == "lightLink" else found.unshadowed) == ALL
    found = light(f"{root} = [</Many/Prototype>, </Fog>]")
    assert (found.unlit if kind == "lightLink" else found.unshadowed) == ALL - {"/Many[0]", "/Many[1]"}


@pytest.mark.parametrize("kind", ["lightLink", "shadowLink"])
def test_a_link_may_be_an_expression(light, kind):
    found = light(f'uniform pathExpression collection:{kind}:membershipExpression = "//Two"\n'
                  f'uniform token collection:{kind}:mode = "expression"')  # fmt: skip
    assert (found.unlit if kind == "lightLink" else found.unshadowed) == ALL - {"/A/Two"}


def test_the_shadow_link_has_no_say_about_the_fog(light):
    found = light("bool collection:shadowLink:includeRoot = 0")
    assert found.unshadowed == ALL
    assert found.emits_beams


def test_a_light_that_leaves_out_the_fog_makes_no_beams(light):
    found = light("rel collection:lightLink:excludes = </Fog>")
    assert (found.unlit, found.unlit_media, found.emits_beams) == (frozenset(), {"/Fog"}, False)


@pytest.mark.parametrize("link, left_out", [
    ("", set()),
    ("rel collection:filterLink:excludes = [</A/Two>, </Fog>]", {"/A/Two", "/Fog"}),
    ("bool collection:filterLink:includeRoot = 0\nrel collection:filterLink:includes = </A>",
     {*ALL, "/Fog"} - {"/A/One", "/A/Two"}),
])  # fmt: skip
def test_a_filter_leaves_out_what_its_link_does(light, link, left_out, caplog):
    found = light(f'rel light:filters = </L/Flag>\ndef PhotonBeamsBlockerFilter "Flag" {{\n{link}\n}}')
    assert [each.left_out for each in found.filters] == [left_out]
    assert not found.unlit and "Flag" not in caplog.text
