"""Write prims that another program describes in plain values, such as Blender's extension.

A description of a prim is a dict:

    path, type      such as "/Scene/Lamp" and "SphereLight"
    apis            names of the schemas that are applied
    matrix          (4, 4), of row vectors: the transform to the parent
    values          by attribute: [type name, value], or [type name, value, interpolation]
    targets         by relationship: paths
    sources         by input or output: [type name, the path of the property that it is connected to]
    samples         by attribute of `values`, or "matrix": [time code, value] of each time sample
    name            what the program calls it, for messages

All but the path and the type may be left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ...scene import SceneError, shown
from ..common import definitions as _schemas  # noqa: F401 - OpenUSD has to know them before the first stage
from ..common.openusd import Gf, Sdf, Usd, UsdGeom, Vt

_TRANSFORM = "xformOp:transform"


def new_stage(up_axis: str, meters_per_unit: float) -> Usd.Stage:
    """Return an empty stage in memory."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
    return stage


def write_prims(stage: Usd.Stage, prims: Iterable[Mapping[str, Any]]) -> None:
    """Write prims into the layer that the stage edits; each replaces what was written of its path and below.

    Raises
    ------
    SceneError
        A description that is none: a path, a type name or a value that OpenUSD does not take.
    """
    layer = stage.GetEditTarget().GetLayer()
    with Sdf.ChangeBlock():
        for each in prims:
            try:
                _write(layer, each)
            except (KeyError, TypeError, ValueError, RuntimeError) as error:  # OpenUSD's own is a RuntimeError
                raise SceneError(f"{each.get('path')} is no description of a prim: {shown(error)}") from error


def copy_prim(prim: Usd.Prim, stage: Usd.Stage, path: str, time: Usd.TimeCode | None = None) -> None:
    """Define a prim on a stage as another one is at a time, whose files have their whole paths."""
    copy = stage.DefinePrim(path, prim.GetTypeName())
    for attribute in prim.GetAuthoredAttributes():
        value = attribute.Get(Usd.TimeCode.EarliestTime() if time is None or time.IsDefault() else time)
        if isinstance(value, Sdf.AssetPath):
            value = Sdf.AssetPath(value.resolvedPath or value.path)
        if value is not None:
            kind, varying = attribute.GetTypeName(), attribute.GetVariability()
            copy.CreateAttribute(attribute.GetName(), kind, attribute.IsCustom(), varying).Set(value)


def remove_prims(stage: Usd.Stage, paths: Iterable[str]) -> None:
    """Remove prims from the layer that the stage edits; paths without a prim are left alone."""
    layer = stage.GetEditTarget().GetLayer()
    with Sdf.ChangeBlock():
        for path in map(Sdf.Path, paths):
            if layer.GetPrimAtPath(path) is not None:
                edit = Sdf.BatchNamespaceEdit()
                edit.Add(path, Sdf.Path.emptyPath)
                layer.Apply(edit)


def _write(layer: Sdf.Layer, given: Mapping[str, Any]) -> None:
    spec = Sdf.CreatePrimInLayer(layer, given["path"])
    spec.specifier, spec.typeName = Sdf.SpecifierDef, given["type"]
    for path in spec.path.GetParentPath().GetPrefixes():  # new parents are overs, of which nothing is seen
        layer.GetPrimAtPath(path).specifier = Sdf.SpecifierDef
    apis = Sdf.TokenListOp()
    apis.prependedItems = given.get("apis", [])
    spec.SetInfo("apiSchemas", apis)
    values, samples = dict[str, Any](given.get("values", {})), dict[str, Any](given.get("samples", {}))
    if "matrix" in given:
        values[_TRANSFORM] = ["matrix4d", given["matrix"]]
        values["xformOpOrder"] = ["token[]", [_TRANSFORM]]
        samples[_TRANSFORM] = samples.pop("matrix", ())
    sources, targets = given.get("sources", {}), given.get("targets", {})
    for own in list(spec.properties):
        spec.RemoveProperty(own)
    for child in list(spec.nameChildren):
        del spec.nameChildren[child.name]
    for name, (kind, value, *interpolation) in values.items():
        attribute = _attribute(spec, name, kind)
        attribute.default = _value(kind, value)
        if interpolation:
            attribute.SetInfo("interpolation", interpolation[0])
        for code, sample in samples.get(name, ()):
            layer.SetTimeSample(attribute.path, code, _value(kind, sample))
    for name, (kind, source) in sources.items():
        _attribute(spec, name, kind).connectionPathList.explicitItems = [Sdf.Path(source)]
    for name, paths in targets.items():
        found = Sdf.RelationshipSpec(spec, name, custom=False)
        found.targetPathList.explicitItems = [Sdf.Path(each) for each in paths]


def _attribute(spec: Sdf.PrimSpec, name: str, kind: str) -> Sdf.AttributeSpec:
    uniform = Sdf.VariabilityUniform if name in _UNIFORM else Sdf.VariabilityVarying
    return Sdf.AttributeSpec(spec, name, Sdf.ValueTypeNames.Find(kind), uniform, declaresCustom=False)


_UNIFORM = {"type", "xformOpOrder", "subdivisionScheme", "elementType", "familyName", "info:id"}


def _value(kind: str, value: Any) -> Any:
    """Return a value as OpenUSD takes it."""
    if kind == "matrix4d":
        return Gf.Matrix4d(np.asarray(value, np.float64).tolist())
    if isinstance(value, np.ndarray):
        return _ARRAYS[kind].FromNumpy(np.ascontiguousarray(value, np.int32 if kind == "int[]" else np.float32))
    if kind == "asset":
        return Sdf.AssetPath(value)
    if kind == "token[]":
        return Vt.TokenArray(value)
    return tuple(value) if isinstance(value, list) else value


#: The arrays that (N,) or (N, C) numbers become at once.
_ARRAYS = {
    "int[]": Vt.IntArray, "float[]": Vt.FloatArray, "point3f[]": Vt.Vec3fArray, "normal3f[]": Vt.Vec3fArray,
    "color3f[]": Vt.Vec3fArray, "texCoord2f[]": Vt.Vec2fArray, "vector3f[]": Vt.Vec3fArray, "float3[]": Vt.Vec3fArray,
}  # fmt: skip
