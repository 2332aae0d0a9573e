"""Which light groups make beams at any time: visibility, purpose and `photonbeams:enabled` decide."""

import pytest

from photonbeams.usd.groups import groups_at_all_times

LIGHT = """def %s "%s" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
    token photonbeams:lightGroup = "%s"
    %s }
"""


def light(group, body="", kind="SphereLight"):
    return LIGHT % (kind, group.title() or "Unnamed", group, body)


def samples(kind, name, first, later):
    return f"{kind} {name}.timeSamples = {{ \n 1: {first}, \n 3: {later} }}\n"


@pytest.mark.parametrize(
    ("body", "found"),
    [
        ("", True),
        ('token visibility = "invisible"', False),
        ('token purpose = "guide"', False),
        ("bool photonbeams:enabled = 0", False),
        (samples("token", "visibility", '"invisible"', '"inherited"'), True),
        (samples("token", "visibility", '"inherited"', '"invisible"'), True),
        (samples("bool", "photonbeams:enabled", 0, 1), True),
        ("float inputs:intensity = 0", True),  # a light that is only dimmed to black keeps its group
    ],
)
def test_a_group_counts_if_its_light_is_ever_on(usd, body, found):
    assert groups_at_all_times(usd(light("") + light("key", body))) == ({"", "key"} if found else {""})


@pytest.mark.parametrize("group", ["a/b", "a b", "\\x1b[1m"])
def test_a_name_that_no_layer_can_have_is_no_group(usd, group):
    text = light("key") + LIGHT % ("SphereLight", "Other", group, "")
    assert groups_at_all_times(usd(text)) == {"", "key"}


def test_what_hides_a_light_and_what_switches_it_off_are_seen_together(usd):
    never = "bool photonbeams:enabled.timeSamples = { \n 1: 1, \n 3: 0 }\n"
    hidden = samples("token", "visibility", '"invisible"', '"inherited"')
    assert groups_at_all_times(usd(f'def Xform "Rig" {{\n{hidden}{light("key", never)} }}')) == frozenset()
    assert groups_at_all_times(usd(f'def Xform "Rig" {{\n{hidden}{light("key")} }}')) == {"key"}


def test_a_group_that_changes_counts_as_all_that_it_is(usd):
    text = 'def SphereLight "A" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {\n'
    text += samples("token", "photonbeams:lightGroup", '"one"', '"two"') + " }"
    assert groups_at_all_times(usd(text)) == {"one", "two"}


def test_what_can_make_no_beams_has_no_group(usd):
    fog = 'def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) { }\n'
    dome = light("dome", "bool photonbeams:enabled = 0", "DomeLight") + light("sky", kind="DomeLight")
    tube = light("tube", kind="PluginLight")
    linked = light("linked", "rel collection:lightLink:excludes = </Fog>")
    assert groups_at_all_times(usd(fog + dome + tube + linked)) == {"sky"}


def test_drawn_curves_have_groups_and_others_none(usd):
    curves = 'def BasisCurves "%s" {\n%s\n%s token photonbeams:lightGroup = "%s" }\n'
    points, power = "point3f[] points = [(0, 0, 0), (1, 0, 0)]", "color3f[] photonbeams:power = [(1, 1, 1)]\n"
    text = curves % ("A", points, power, "drawn") + curves % ("B", points, "", "guide") + curves % ("C", "", power, "x")
    assert groups_at_all_times(usd(text)) == {"drawn"}


def test_instances_and_prototypes_have_the_groups_of_their_prims(usd):
    text = f"""
def Xform "Rig" (
    prepend references = </Lamps>
    instanceable = true
) {{
 }}
def PointInstancer "Many" {{
    rel prototypes = </Many/Lamp>
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 0)]
    {samples("token", "visibility", '"invisible"', '"inherited"')}
    def Xform "Lamp" {{
{light("many")}
{light("hidden", 'token visibility = "invisible"')} }} }}
class Xform "Lamps" {{
{light("rig")} }}
"""
    assert groups_at_all_times(usd(text)) == {"rig", "many"}
