"""Warnings about references, payloads and sublayers that OpenUSD could not compose, in sentences for users."""

from __future__ import annotations

import os
import re
from typing import Any

from ..common.openusd import Sdf, Usd, text_of
from ..common.reading import file_of
from ..common.warnings import Warnings

_ARC = re.compile(r"Could not open asset @(.*?)@ for (\S+) introduced by @.*?@<(.*?)>(?: -- (.*))?")
_TARGET = re.compile(r"Unresolved (\S+) prim path @(.*?)@<(.*?)> introduced by @.*?@<(.*?)>")
_SUBLAYER = re.compile(r"Could not load sublayer @(.*?)@ of layer @(.*?)@(?: -- (.*))?")
_CYCLE = re.compile(r"Cycle detected: @.*?@<(.*?)>")
_SUBLAYER_CYCLE = re.compile(r"has cycles. Detected when layer @(.*?)@ was seen")
_LEFT_OUT = "; it is left out"  # ends sentences about what is missing; other errors are mistakes in what is there
_SITE = re.compile(r"@([^@]*?)(?:,@anon:[^@]*@)?@?(?=<)")


def warn_of_composition(stage: Usd.Stage, warnings: Warnings) -> None:
    """Warn about everything that the stage was composed without."""
    file = file_of(stage)
    # The message begins with the stage's own folder, so files in it are named without the folder.
    folder = os.path.join(os.path.dirname(file), "")
    with warnings.together():
        for error in stage.GetCompositionErrors():
            text = _sentence(error).replace(f"@{folder}", "@")
            (warnings.lack if text.endswith(_LEFT_OUT) else warnings.give)(text, file)


def _sentence(error: Any) -> str:
    """Return what is wrong, from the text of OpenUSD's error, which also names its own session layer."""
    text = " ".join(text_of(error).split()).removesuffix("; skipping.").rstrip(". ")
    if found := _ARC.match(text):
        asset, kind, prim, reason = found.groups()
        return f"{prim} has a {kind} to @{asset}@, {_unread(asset, reason)}{_LEFT_OUT}"
    if found := _TARGET.match(text):
        kind, asset, target, prim = found.groups()
        if target == "defaultPrim":
            return f"{prim} has a {kind} to @{asset}@, which names no default prim{_LEFT_OUT}"
        return f"{prim} has a {kind} to @{asset}@<{target}>, which has no such prim{_LEFT_OUT}"
    if found := _SUBLAYER.match(text):
        asset, layer, reason = found.groups()
        return f"@{layer}@ has a sublayer @{asset}@, {_unread(asset, reason)}{_LEFT_OUT}"
    if found := _CYCLE.match(text):
        return f"{found[1]} refers to itself, directly or through others; that reference is left out"
    if found := _SUBLAYER_CYCLE.search(text):
        return f"@{found[1]}@ is among its own sublayers; it is used once"
    return f"{_SITE.sub('', text)}; the stage is composed without it"


def _unread(asset: str, reason: str | None) -> str:
    """Return why a file cannot be read, as a clause."""
    suffix = os.path.splitext(asset)[1]
    if not reason or not os.path.exists(asset):
        return "which is not there"
    if not Sdf.FileFormat.FindByExtension(asset):
        return f"but OpenUSD reads no *{suffix} files here"
    line = re.fullmatch(r".*?:(\d+):\d+: (.*)", reason)
    return f"which cannot be read (line {line[1]}: {line[2]})" if line else "which cannot be read"
