"""What the schemas say of their attributes, and what is made from them."""

import pytest
from pxr import Sdf, Usd

from photonbeams.usd.common.definitions import (
    BLOCKER,
    CAMERA,
    CURVES,
    FOLDER,
    LIGHT,
    LOOK,
    MEDIUM,
    PREFIX,
    RAMP,
    Definition,
    definitions,
)
from tools.schema import files

SCHEMAS = (CAMERA, CURVES, LIGHT, LOOK, MEDIUM, BLOCKER, RAMP)
#: Schemas of prims by their base, which other schemas apply to prims.
TYPED = {LOOK: "/Typed", BLOCKER: "/LightFilter", RAMP: "/LightFilter"}


@pytest.mark.parametrize("path", files(), ids=lambda path: path.name)
def test_what_is_made_from_the_schemas_is_up_to_date(path):
    """If it is not, run `python tools/schema.py`."""
    assert path.read_text() == files()[path]


@pytest.mark.parametrize("schema", SCHEMAS)
def test_openusd_knows_the_same_of_every_attribute(schema):
    registry = Usd.SchemaRegistry()
    known = registry.FindAppliedAPIPrimDefinition(schema) or registry.FindConcretePrimDefinition(schema)
    assert {*definitions(schema)} == {name for name in known.GetPropertyNames() if name.startswith(PREFIX)}
    for name, own in definitions(schema).items():
        assert Definition.of(known.GetSchemaPropertySpec(name)) == own
        assert own.doc


def test_usdgenschema_reads_the_source():
    """Its two parts that only it reads name OpenUSD's base classes and the kinds of the schemas."""
    source = Sdf.Layer.FindOrOpen(str(FOLDER / "schema.usda"))
    assert {spec.name for spec in source.rootPrims} == {"GLOBAL", *SCHEMAS}
    for name in SCHEMAS:
        spec = source.GetPrimAtPath(f"/{name}")
        (base,) = spec.inheritPathList.prependedItems or spec.inheritPathList.explicitItems
        assert base == TYPED.get(name, "/APISchemaBase")
        assert ("apiSchemaType" in spec.customData) is (name not in TYPED)


def test_a_range_is_one_for_all_programs():
    """Other programs find the ranges as OpenUSD's limits."""
    stage = Usd.Stage.CreateInMemory()
    width = stage.DefinePrim("/Look", LOOK).GetAttribute("photonbeams:across:width")
    hard, soft = width.GetHardLimits(), width.GetSoftLimits()
    assert (hard.GetMinimum(), hard.GetMaximum(), soft.GetMaximum()) == (pytest.approx(0.02), 10, 2)
    own = definitions(LOOK)["photonbeams:across:width"]
    assert (own.least, own.most, own.slider) == (0.02, 10, (0.02, 2))
