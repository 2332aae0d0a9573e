"""What a stage holds, as a hash: the same for the same shot wherever its files lie, another after any change."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from typing import Any

from pxr import Ar, Usd, UsdUtils

from ..runtime.digest import digest


def stage_digest(stage: Usd.Stage) -> str:
    """Return a hash of a stage as it is composed, session layer included, and of the files that it names."""
    layer = stage.Flatten(addSourceFileComment=False)
    UsdUtils.ModifyAssetPaths(layer, cache(_file_digest))
    return digest(layer.ExportToString())


def _file_digest(name: str) -> str:
    """Return a hash of the file of an asset path, or the path itself where there is none."""
    resolved = str(Ar.GetResolver().Resolve(name))
    asset: Any = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved)) if resolved else None
    return name if asset is None else sha256(asset.GetBuffer()).hexdigest()
