"""Warn about what a stage sets for photonbeams without effect: misspelt attributes, and missing prims."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from functools import cache, partial
from itertools import islice

from .common.definitions import BLOCKER, CAMERA, CURVES, LIGHT, LOOK, MEDIUM, RAMP, definitions
from .common.openusd import Sdf, Usd, UsdGeom, UsdRender
from .common.reading import Reading, prims_under, target_paths
from .common.warnings import Warnings
from .lights.light import is_light
from .settings import PIXEL_FILTER, SINGLE_PART

_MOST_PATHS = 10_000  # among which to look for the intended one


def warn_of_unread(stage: Usd.Stage, warnings: Warnings) -> None:
    """Warn about photonbeams' attributes that their prims cannot have, and about `over`s of missing prims."""
    reading, prototypes = Reading(stage, warnings=warnings), cache(partial(_prototypes, stage))
    with warnings.together():
        for prim in Usd.PrimRange.AllPrims(stage.GetPseudoRoot()):
            reading.attempt(prim, partial(_warn_of, reading, prim, prototypes), None, "it is not checked")


def _warn_of(reading: Reading, prim: Usd.Prim, prototypes: Callable[[], frozenset[Sdf.Path]]) -> None:
    said = [each.GetName() for each in prim.GetAuthoredPropertiesInNamespace("photonbeams")]
    if not said and not (prim.HasAuthoredMetadata("apiSchemas") and not prim.IsDefined() and _applied(prim)):
        return
    if not prim.IsActive() or prim.IsAbstract():
        return
    if not prim.IsDefined():
        if not any(path in prototypes() for path in prim.GetPath().GetPrefixes()):
            reading.warn(prim, f"is an `over` of a prim that is not there: its values are ignored{_meant(prim)}")
    elif prim.GetTypeName() != LOOK:  # looks are checked when they are read
        for name in said:
            if name not in _known(prim):
                reading.warn_of_unknown(prim, name, _known(prim))


def _known(prim: Usd.Prim) -> frozenset[str]:
    """Return the names of photonbeams' attributes that a prim may have."""
    if prim.IsA(UsdRender.Product):
        return frozenset({PIXEL_FILTER, SINGLE_PART})
    if prim.IsA(UsdRender.Settings):
        return frozenset({PIXEL_FILTER})
    if prim.GetTypeName() in (BLOCKER, RAMP):
        return frozenset(definitions(str(prim.GetTypeName())))
    names = {*definitions(MEDIUM)}
    if is_light(prim):
        names |= {*definitions(LIGHT)}
    if prim.IsA(UsdGeom.Camera):
        names |= {*definitions(CAMERA)}
    if prim.IsA(UsdGeom.Curves):
        names |= {*definitions(CURVES)}
    return frozenset(names)


def _applied(prim: Usd.Prim) -> bool:
    listed = prim.GetMetadata("apiSchemas")
    return any(name.startswith("PhotonBeams") for name in listed.GetAddedOrExplicitItems())


def _prototypes(stage: Usd.Stage) -> frozenset[Sdf.Path]:
    """Return the paths of the prototypes of point instancers, which may be `over`s."""
    instancers = (prim for prim in prims_under(stage.GetPseudoRoot()) if prim.IsA(UsdGeom.PointInstancer))
    return frozenset(path for prim in instancers for path in target_paths(prim, "prototypes"))


def _meant(prim: Usd.Prim) -> str:
    """Return the prim that an `over` was probably meant for, as the end of a sentence."""
    paths = [str(each.GetPath()) for each in islice(prims_under(prim.GetStage().GetPseudoRoot()), 1, _MOST_PATHS)]
    own, same = str(prim.GetPath()), [path for path in paths if path.rpartition("/")[2] == prim.GetName()]
    near = get_close_matches(own, same, 1, 0) or get_close_matches(own, paths, 1, 0.75)
    return f"; expected {near[0]}" if near else ""
