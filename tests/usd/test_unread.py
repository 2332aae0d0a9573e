"""A warning names attributes and `over` prims that nothing reads, and suggests what was probably meant."""

import logging

import pytest

from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.unread import warn_of_unread
from tests.helpers.usda import prim


@pytest.fixture
def told(usd, caplog):
    """Return a function that returns the warnings about a stage, without the file's name."""
    caplog.set_level(logging.WARNING, "photonbeams")

    def told(*prims):
        warn_of_unread(usd("".join(prims)), Warnings())
        return [each.partition("stage.usda: ")[2] for each in caplog.messages]

    return told


@pytest.mark.parametrize(
    ("kind", "line", "expected"),
    [
        ("SphereLight", "float photonbeams:intensty = 2", "SphereLight: it is ignored; expected photonbeams:intensity"),
        ("SphereLight", "rel photonbeams:portals", "SphereLight: it is ignored; expected photonbeams:portal"),
        ("BasisCurves", "float photonbeams:powr = 2", "BasisCurves: it is ignored; expected photonbeams:power"),
        ("Scope", "color3f photonbeams:scatering = (1, 1, 1)", "Scope: it is ignored; expected photonbeams:scattering"),
        ("Mesh", "float photonbeams:gobo:angle = 3", "Mesh: it is ignored"),
        (
            "RenderSettings",
            'token photonbeams:pixelFiltr = "box"',
            "RenderSettings: it is ignored; expected photonbeams:pixelFilter",
        ),
    ],
)
def test_a_misspelt_attribute_is_told(told, kind, line, expected):
    name = line.split()[1]
    assert told(f'def {kind} "A" {{\n    {line}\n}}\n') == [f"/A.{name} is not an attribute of a {expected}"]


def test_an_over_of_what_is_not_there_is_told(told):
    text = 'over "Attic" {\n over "Spt" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {\n}\n over "SomethingElse" {\n'
    text += " float photonbeams:count = 3\n}\n}\n"
    attic = f'def Xform "Attic" {{\n{prim("SphereLight", "Spot", (0, 0, 0))}}}\n'
    told_of = "is an `over` of a prim that is not there: its values are ignored"
    assert told(attic, text.replace("Attic", "Atic")) == [
        f"/Atic/Spt {told_of}; expected /Attic/Spot", f"/Atic/SomethingElse {told_of}",
    ]  # fmt: skip


def test_what_is_read_is_not_told(told):
    instancer = 'def PointInstancer "I" {\n rel prototypes = </P>\n}\nover "P" {\n'
    instancer += ' over "L" {\n float photonbeams:intensity = 2\n}\n}\n'
    lines = "float photonbeams:intensity = 2", "rel photonbeams:portal = </A>", "float photonbeams:anisotropy = 0.5"
    light = prim("SphereLight", "A", (0, 0, 0), *lines)
    hidden = 'class "C" {\n float photonbeams:nonsense = 2\n}\nover "Other" {\n float other = 2\n}\n'
    assert told(light, instancer, hidden) == []
