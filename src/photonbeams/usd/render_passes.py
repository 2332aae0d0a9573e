"""Render passes (UsdRenderPass): the settings of a pass, and what it renders."""

from __future__ import annotations

from collections.abc import Iterator

from ..scene import SceneError
from .common.openusd import Sdf, Usd, UsdGeom, UsdRender
from .common.reading import Reading, file_of, prims_under
from .common.visibility import CAMERA, MATTE
from .common.warnings import Warnings
from .lights.light import is_light


def apply_pass(stage: Usd.Stage, path: str, warnings: Warnings | None = None) -> str | None:
    """Hide what a pass does not render, in the stage's session layer; return the path of its settings, or None.

    Prims in the collection `prune`, and those that `renderVisibility` leaves out, are not rendered. Those in `matte`
    are holdouts, and those that `cameraVisibility` leaves out are not seen. The pass's command is not run.

    Raises
    ------
    SceneError
        There is no pass at that path, or its configuration is in another file or is not a RenderSettings.
    """
    reading = Reading(stage, warnings=warnings or Warnings())
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsPrimPath() else None
    if not prim or not prim.IsA(UsdRender.Pass):
        names = [str(each.GetPath()) for each in stage.Traverse() if each.IsA(UsdRender.Pass)]
        expected = f"one of {', '.join(names)}" if names else "a RenderPass prim"
        raise SceneError(f"{file_of(stage)} has no render pass '{path}': expected {expected}")
    if prim.GetAttribute("fileName").HasAuthoredValue() and reading.value(prim, "fileName").path:
        raise reading.fail(prim, "fileName", "names another file: expected a pass whose settings are on this stage")
    sources = reading.targets(prim, "renderSource")
    for each in sources:
        if not each.IsA(UsdRender.Settings):
            raise reading.fail(prim, "renderSource", f"names {each.GetPath()}: expected a RenderSettings")
    _hide(reading, prim)
    return str(sources[0].GetPath()) if sources else None


def _hide(reading: Reading, prim: Usd.Prim) -> None:
    """Make invisible what the pass does not render, hide from the camera what it does not see, and set holdouts."""
    pruned, shown, seen, held = (
        Usd.CollectionAPI(prim, name).ComputeMembershipQuery()
        for name in ("prune", "renderVisibility", "cameraVisibility", "matte")
    )
    with Usd.EditContext(reading.stage, reading.stage.GetSessionLayer()):
        for each in list(_rendered(reading.stage)):
            path = each.GetPath()
            hidden = pruned.IsPathIncluded(path) or not shown.IsPathIncluded(path)
            wanted = {CAMERA: False} if not seen.IsPathIncluded(path) else {}
            wanted |= {MATTE: True} if held.IsPathIncluded(path) else {}
            if each.IsInstanceProxy() and (hidden or wanted):
                done = f"leaves out {path}, which is" if hidden else f"hides or holds out {path}, which is"
                reading.warn(prim, f"{done} inside an instance: it is rendered anyway")
            elif hidden:
                UsdGeom.Imageable(each).CreateVisibilityAttr().Set("invisible")
            else:
                for name, value in wanted.items():
                    each.CreateAttribute(name, Sdf.ValueTypeNames.Bool).Set(value)


def _rendered(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Return the prims that are rendered: shapes, lights, and instancers of these."""
    for prim in prims_under(stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.Boundable) or prim.IsA(UsdGeom.PointInstancer) or is_light(prim):
            yield prim
