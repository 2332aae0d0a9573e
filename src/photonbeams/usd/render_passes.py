"""Render passes (UsdRenderPass): the settings of a pass, and what it renders."""

from __future__ import annotations

from collections.abc import Iterator

from ..scene import SceneError
from .common.openusd import Sdf, Usd, UsdGeom, UsdRender
from .common.reading import Reading, file_of, prims_under
from .common.warnings import Warnings
from .lights.light import is_light


def apply_pass(stage: Usd.Stage, path: str, warnings: Warnings | None = None) -> str | None:
    """Hide what a pass does not render, in the stage's session layer; return the path of its settings, or None.

    Prims in the collection `prune`, and those that `renderVisibility` leaves out, are not rendered. `matte` and
    `cameraVisibility` only give a warning, because everything rendered is seen by all rays. The pass's command is not
    run.

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
    _warn(reading, prim)
    return str(sources[0].GetPath()) if sources else None


def _hide(reading: Reading, prim: Usd.Prim) -> None:
    """Make everything invisible that the pass does not render."""
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
    """Warn about settings of a pass that are not supported."""
    matte = Usd.CollectionAPI(prim, "matte")
    if matte.GetIncludesRel().GetTargets() or matte.GetIncludeRootAttr().Get() or _by_expression(matte):
        reading.warn(prim, "is not supported: its prims are seen as they are", "collection:matte")
    camera = Usd.CollectionAPI(prim, "cameraVisibility")
    if camera.GetExcludesRel().GetTargets() or not camera.GetIncludeRootAttr().Get() or _by_expression(camera):
        reading.warn(prim, "is not supported: the camera sees all that is rendered", "collection:cameraVisibility")


def _by_expression(collection: Usd.CollectionAPI) -> bool:
    """Return whether a path expression says what a collection contains."""
    return not collection.IsInRelationshipsMode() and bool(collection.ResolveCompleteMembershipExpression())
