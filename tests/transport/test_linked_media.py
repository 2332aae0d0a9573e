"""Media that the links of lights leave out: they dim light as media that only absorb do."""

import numpy as np

from photonbeams import Shot

# Two boxes of fog behind each other; lamps on both sides shine through both.
STAGE = """
def Cube "Near" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {{
    color3f photonbeams:{near} = (0.5, 0.3, 0.2)
    {more}
    double3 xformOp:translate = (-1.5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Cube "Far" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {{
    color3f photonbeams:scattering = (0.4, 0.4, 0.4)
    double3 xformOp:translate = (1.5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def SphereLight "Lamp" {{
    float inputs:radius = 0.2
    float inputs:intensity = 100
    int photonbeams:count = 16384
    {link}
    double3 xformOp:translate = (-4, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def SphereLight "Other" {{
    float inputs:radius = 0.2
    float inputs:intensity = 100
    token photonbeams:lightGroup = "other"
    double3 xformOp:translate = (4, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Camera "Camera" {{
    float horizontalAperture = 30
    float verticalAperture = 15
    double3 xformOp:translate = (0, 0, 9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""
LINK = "rel collection:lightLink:excludes = </Near>"


def beams(usd, near, link, more="", **settings):
    """Return the beams of the lamp with the link, and those of the other one."""
    shot = Shot(usd(STAGE.format(near=near, link=link, more=more)))
    layers = shot.render(width=32, height=16, passes=2, **settings).layers
    return layers["beams_default"], layers["beams_other"]


def test_a_fog_that_a_link_leaves_out_only_absorbs_the_lights_light(usd):
    settings = {"more": "float photonbeams:noise:amount = 0.5"}
    (linked, other), (absorbing, _) = (
        beams(usd, *each, **settings) for each in (("scattering", LINK), ("absorption", ""))
    )
    assert linked[:, :14].max() == 0 < linked[:, 16:].max()
    assert other[:, :14].mean() > 0 < other[:, 16:].mean()
    # The paths of light are the same; which of them get through differs by noise.
    np.testing.assert_allclose(linked.mean(axis=(0, 1)), absorbing.mean(axis=(0, 1)), rtol=0.02)


def test_what_a_link_leaves_out_scatters_nothing_where_light_bounces(usd):
    """Where light bounces once, what is scattered in one fog lights the other: here none that the link leaves out."""
    settings = {"max_depth": 3}
    (linked, _), (absorbing, _) = (beams(usd, *each, **settings) for each in (("scattering", LINK), ("absorption", "")))
    np.testing.assert_allclose(linked[:, 16:].mean(axis=(0, 1)), absorbing[:, 16:].mean(axis=(0, 1)), rtol=0.03)
