"""Render passes, by UsdRenderPass: which settings a pass has, and what is rendered in it."""

from __future__ import annotations

from collections.abc import Iterator

from ..scene import SceneError
from .lights import is_light
from .openusd import Sdf, Usd, UsdGeom, UsdRender
from .reading import Reading, file_of, prims_under
from .warnings import Warnings


def apply_pass(stage: Usd.Stage, path: str, warnings: Warnings | None = None) -> str | None:
    """Show on a stage what a pass renders, in its session layer; return the path of the pass's settings, if it has any.

    Prims of the collection `prune`, and those that `renderVisibility` leaves out, are not rendered. What `matte` and
    `cameraVisibility` say is warned of: here, what is rendered is seen by all rays. The pass's command is not run.

    Raises
    ------
    SceneError
        No pass at that path, or one whose configuration is in another file or is no RenderSettings.
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
    _warn(reading, prim)
    return str(sources[0].GetPath()) if sources else None


def _hide(reading: Reading, prim: Usd.Prim) -> None:
    """Make invisible what the pass does not render."""
    pruned, shown = (Usd.CollectionAPI(prim, name).ComputeMembershipQuery() for name in ("prune", "renderVisibility"))
    hidden = [
        each
        for each in _rendered(reading.stage)
        if pruned.IsPathIncluded(each.GetPath()) or not shown.IsPathIncluded(each.GetPath())
    ]
    with Usd.EditContext(reading.stage, reading.stage.GetSessionLayer()):
        for each in hidden:
            if each.IsInstanceProxy():
                reading.warn(prim, f"leaves out {each.GetPath()}, which is inside an instance: it is rendered anyway")
            else:
                UsdGeom.Imageable(each).CreateVisibilityAttr().Set("invisible")


def _rendered(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Return the prims that are rendered: shapes, lights, and instancers of these."""
    for prim in prims_under(stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.Boundable) or prim.IsA(UsdGeom.PointInstancer) or is_light(prim):
            yield prim


def _warn(reading: Reading, prim: Usd.Prim) -> None:
    """Warn of what a pass says that is not done."""
    matte = Usd.CollectionAPI(prim, "matte")
    if matte.GetIncludesRel().GetTargets() or matte.GetIncludeRootAttr().Get():
        reading.warn(prim, "is not supported: its prims are seen as they are", "collection:matte")
    camera = Usd.CollectionAPI(prim, "cameraVisibility")
    if camera.GetExcludesRel().GetTargets() or not camera.GetIncludeRootAttr().Get():
        reading.warn(prim, "is not supported: the camera sees all that is rendered", "collection:cameraVisibility")
