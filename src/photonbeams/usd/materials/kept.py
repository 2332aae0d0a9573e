"""The cache of materials and their textures, which hardly ever change with time."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from ..common.openusd import Usd, UsdShade
from ..common.reading import PROTOTYPE_PRIMS, Cache, Reading
from ..common.textures import FILES, stamp

_MATERIALS, _VARY = ("materials",), ("materials vary",)


def kept(reading: Reading) -> Cache:
    """Return the cache of materials: that of all times, unless a shader may vary or a file was written again."""
    if _MATERIALS not in reading.cache:
        reading.cache[_MATERIALS] = _cache(reading)
    found: Cache = reading.cache[_MATERIALS]
    return found


def _cache(reading: Reading) -> Cache:
    lasting = reading.lasting
    if _VARY not in lasting:
        prims = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(PROTOTYPE_PRIMS))
        lasting[_VARY] = any(_varies(reading, each) for each in prims if _is_shading(each))
    if lasting[_VARY] or reading.warnings.muted:  # what is wrong with a material has to be said when it is rendered
        return reading.cache
    files = lasting.setdefault(FILES, {})
    if any(_stamp(path) != known for path, known in files.items()):
        files.clear()
        lasting.pop(_MATERIALS, None)
    result: Cache = lasting.setdefault(_MATERIALS, {})
    return result


def _stamp(path: str) -> Any:
    """Return the stamp of a file; None if it is gone."""
    with suppress(OSError):
        return stamp(path)
    return None


def _is_shading(prim: Usd.Prim) -> bool:
    return prim.IsA(UsdShade.Shader) or prim.IsA(UsdShade.NodeGraph)


def _varies(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a shader or node graph may change with time, or reads from a prim that is neither."""
    attributes = prim.GetAuthoredAttributes()
    sources = [reading.stage.GetPrimAtPath(path.GetPrimPath()) for each in attributes for path in each.GetConnections()]
    return reading.varies(prim) or any(each and not _is_shading(each) for each in sources)
