"""Corrections for what Blender's exporter writes differently from UsdLux, found by exporting with Blender 5.0.1.

They apply to prims that a layer from Blender defines; Blender signs its layers with `doc = "Blender v..."`. A sun's
intensity or a dome's transform that another layer overrides is used as it is.
"""

from __future__ import annotations

from math import log

import numpy as np

from ...scene import Array
from .openusd import Gf, Sdf, Usd, UsdGeom
from .reading import Reading, prims_under


def wrote(prim: Usd.Prim) -> bool:
    """Return whether a light's intensity, or else the light itself, comes from a layer that Blender wrote."""
    attribute = prim.GetAttribute("inputs:intensity")
    specs = attribute.GetPropertyStack() if attribute and attribute.HasAuthoredValue() else prim.GetPrimStack()
    return bool(specs) and _signed(specs[0].layer)


def _signed(layer: Sdf.Layer) -> bool:
    return str(layer.documentation).startswith("Blender v")


def sun(angle: float, value: Array) -> tuple[float, Array]:
    """Return the angle and intensity of a sun in Blender, from those that it exports.

    For a sun of 3 W/m² and 1°, Blender writes a normalized DistantLight of intensity 0.75 and angle 0.5. Its own
    importer multiplies them by 4 and by 2 again.
    """
    return 2 * angle, 4 * value


def unit(reading: Reading, prim: Usd.Prim) -> float:
    """Return how many scene units long Blender's unit is, where Blender exported a prim in a unit other than metres.

    Blender then scales its root, or all that has no parent, by 1 / `metersPerUnit`; what it counts per metre or per
    square metre, it writes as it is: the power of lamps, and the density of volumes. 1: there is nothing to convert.
    """
    signed = (spec.layer for spec in prim.GetPrimStack() if spec.specifier == Sdf.SpecifierDef and _signed(spec.layer))
    layer = next(signed, None)
    meters = 1.0 if layer is None else float(layer.pseudoRoot.GetInfo("metersPerUnit") or 1.0)
    if meters == 1 or meters <= 0:
        return 1.0
    top, parent = prim, prim.GetParent()
    while not parent.IsPseudoRoot() and any(spec.layer == layer for spec in parent.GetPrimStack()):
        top, parent = parent, parent.GetParent()
    whole = _scale(reading.xforms.GetLocalToWorldTransform(top))
    above = _scale(reading.xforms.GetParentToWorldTransform(top))
    if not (whole > 0 and above > 0):
        return 1.0
    # Versions before the choice of units wrote `metersPerUnit` without scaling; and objects have scales of their own.
    own = whole / above
    return above / meters if abs(log(own * meters)) < abs(log(own)) else 1.0


def _scale(matrix: Gf.Matrix4d) -> float:
    return float(abs(matrix.GetDeterminant3()) ** (1 / 3))


def lost_world_rotation(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    """Return whether a dome light is a Blender world that was exported without its orientation.

    Blender turns a DomeLight so that its pole is Z and its middle +X, but 5.0.1 does so only for worlds that have a
    Mapping node, and writes no rotation for the others.
    """
    if not any(_signed(spec.layer) for spec in prim.GetPrimStack() if spec.specifier == Sdf.SpecifierDef):
        return False
    order = prim.GetAttribute("xformOpOrder").GetPropertyStack()
    if order and not _signed(order[0].layer):  # another layer set the orientation
        return False
    return np.allclose(np.array(UsdGeom.Xformable(prim).GetLocalTransformation(time)), np.eye(4))


def world() -> Array:
    """Return the rotation (3, 3) of a Blender world: pole from +Y to +Z, the image's middle from +Z to +X."""
    return np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def wrote_prim(prim: Usd.Prim) -> bool:
    """Return whether a material, a volume or an object comes from a layer that Blender wrote."""
    return any(_signed(spec.layer) for spec in prim.GetPrimStack())


def move_properties(stage: Usd.Stage) -> None:
    """Move photonbeams' attributes of Blender's objects to their lights, volumes and meshes, in the session layer.

    Blender writes an object's custom properties on an Xform above its data, where fog would fill the whole space.
    """
    if not any(map(_signed, stage.GetUsedLayers())):
        return
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for prim in prims_under(stage.GetPseudoRoot()):
            if prim.GetTypeName() != "Xform" or prim.IsInstanceProxy():
                continue
            own = [
                each for each in prim.GetAuthoredPropertiesInNamespace("photonbeams") if isinstance(each, Usd.Attribute)
            ]
            data = [each for each in prim.GetChildren() if each.GetTypeName() not in ("Xform", "Scope", "")]
            if own and len(data) == 1 and wrote_prim(prim):
                for each in own:
                    _move(each, data[0])


def _move(attribute: Usd.Attribute, prim: Usd.Prim) -> None:
    """Move an attribute to another prim, unless that one has its own."""
    name = attribute.GetName()
    if attribute.HasAuthoredValue() and not prim.GetAttribute(name).HasAuthoredValue():
        attribute.FlattenTo(prim)
    attribute.Block()
