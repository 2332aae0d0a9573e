"""A hash of a stage's content, which does not depend on where its files are and differs after any change."""

from __future__ import annotations

import os
from functools import cache
from hashlib import sha256
from typing import Any

from ...runtime.digest import digest
from ..common.openusd import Ar, Usd, UsdUtils
from ..common.textures import texture_limit


def stage_digest(stage: Usd.Stage) -> str:
    """Return a hash of the composed stage, including its session layer, and of the files that it names."""
    layer = stage.Flatten(addSourceFileComment=False)
    UsdUtils.ModifyAssetPaths(layer, cache(_file_digest))
    return digest(layer.ExportToString(), texture_limit(stage))


def _file_digest(name: str) -> str:
    """Return a hash of the file that an asset path names, or the file's name if there is no file."""
    resolver = Ar.GetResolver()
    resolved = str(resolver.Resolve(name))
    outer = Ar.SplitPackageRelativePathOuter(resolved)[0] if resolved else ""
    # An empty file counts as a file here, unlike in `runtime.inputs`: it is another content than none.
    is_file = os.path.isfile(outer) and os.access(outer, os.R_OK)
    asset: Any = resolver.OpenAsset(Ar.ResolvedPath(resolved)) if is_file else None
    return os.path.basename(name) if asset is None else sha256(asset.GetBuffer() or b"").hexdigest()
