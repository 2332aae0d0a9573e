"""docs/usdlux.md has every attribute of UsdLux with its fallback, and names tests that exist."""

import re
from pathlib import Path

import pytest

from photonbeams.usd.common.openusd import Usd

TESTS = Path(__file__).parents[1]
PAGE = (TESTS.parent / "docs/usdlux.md").read_text()
ROWS = [
    [cell.strip() for cell in re.split(r"(?<!\\\\)\|", line)[1:-1]]
    for line in PAGE.splitlines()
    if line.startswith("|")
]
SCHEMAS = ("LightAPI", "SphereLight", "RectLight", "DiskLight", "CylinderLight", "DistantLight", "DomeLight",
           "DomeLight_1", "MeshLightAPI", "ShapingAPI", "ShadowAPI")  # fmt: skip
#: What every prim or collection has.
COMMON = ("collection:", "extent", "proxyPrim", "purpose", "visibility", "xformOpOrder")


def definition(schema):
    registry = Usd.SchemaRegistry()
    return registry.FindAppliedAPIPrimDefinition(schema) or registry.FindConcretePrimDefinition(schema)


@pytest.mark.parametrize("schema", SCHEMAS)
def test_every_attribute_has_a_row(schema):
    listed = {name for row in ROWS for name in re.findall(r"`([\w:]+)`", row[0])}
    names = {name for name in definition(schema).GetPropertyNames() if not name.startswith(COMMON)}
    assert names <= listed


def test_fallbacks_are_those_of_the_installed_schema():
    known = {}
    for schema in SCHEMAS:
        for name in definition(schema).GetPropertyNames():
            if attribute := definition(schema).GetAttributeDefinition(name):
                value = attribute.GetFallbackValue()
                known.setdefault(name, set()).add(f"{value:g}" if type(value) is float else str(value))
    told = [(row[0].strip("`"), row[1]) for row in ROWS if len(row) == 4 and row[0].strip("`") in known and row[1]]
    assert len(told) > 30
    for name, value in told:
        assert value.replace("−", "-") in known[name], name


def test_every_row_names_a_test_that_exists():
    written = {
        name for path in TESTS.rglob("test_*.py") for name in re.findall(r"^def (test_\w+)", path.read_text(), re.M)
    }
    assert set(re.findall(r"`(test_\w+)`", PAGE)) <= written
    for row in ROWS:
        heading = row[0].startswith("**") or row[-1] == "test" or set(row[0]) <= set("-:")
        assert heading or len(row) == 3 or re.fullmatch(r"`test_\w+`", row[-1]), row
