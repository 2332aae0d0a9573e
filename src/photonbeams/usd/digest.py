"""A hash of a stage's content, which does not depend on where its files are and differs after any change."""

from __future__ import annotations

import os
from functools import cache
from hashlib import sha256
from typing import Any

from ..runtime.digest import digest
from ..runtime.inputs import why_unreadable
from .openusd import Ar, Usd, UsdUtils
from .textures import texture_limit


def stage_digest(stage: Usd.Stage) -> str:
    """Return a hash of the composed stage, including its session layer, and of the files that it names."""
    layer = stage.Flatten(addSourceFileComment=False)
    UsdUtils.ModifyAssetPaths(layer, cache(_file_digest))
    return digest(layer.ExportToString(), texture_limit(stage))


def _file_digest(name: str) -> str:
    """Return a hash of the file that an asset path names, or the file's name if there is no file."""
    resolver = Ar.GetResolver()
    resolved = str(resolver.Resolve(name))
    is_file = resolved and not why_unreadable(Ar.SplitPackageRelativePathOuter(resolved)[0])
    asset: Any = resolver.OpenAsset(Ar.ResolvedPath(resolved)) if is_file else None
    return os.path.basename(name) if asset is None else sha256(asset.GetBuffer() or b"").hexdigest()
