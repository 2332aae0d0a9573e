"""Prepare the layers of a stage before it is composed.

Unreadable files, MaterialX documents and metadata that make no sense are replaced.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from ...runtime.files import PathLike, atomic_path, failure_of, sync, write_bytes
from ...runtime.inputs import opened, why_unreadable
from ...runtime.limits import bounded
from ...scene import SceneError
from ..common.openusd import Ar, Sdf, Tf, sentences_of
from ..common.reading import quiet
from ..common.textures import stamp
from ..common.warnings import Warnings
from . import materialx
from .clips import leave_out_clips
from .counting import DEEPEST, is_deep
from .metadata import correct_metadata

_MOST_TEXT = 1 << 32  # bytes
_LEAST_ROOM = 1 << 31  # bytes that reading a layer may take, however small it is
_SPEC_ROOM = 256  # bytes, for each byte of a file: a prim takes about 500, and two or more in a file
_SMALL = 1 << 26  # bytes of files whose arrays are all read before anybody else does

#: Layers changed in memory: they differ from their files, and have to be read again.
_CHANGED: set[str] = set()


def ready_layers(root: Sdf.Layer, session: Sdf.Layer, warnings: Warnings) -> dict[Sdf.Layer, list[Sdf.Path]]:
    """Return two layers and all layers that they refer to, as their files are, with the prims in them.

    They have to be kept alive until a stage is composed. OpenUSD opens whatever a layer names, and would wait for ever
    on a named pipe; such references and value clips are removed in memory, with a warning. OpenUSD's wheels know the
    nodes of MaterialX, but have no plug-in for its documents; in memory, layers then name a translation.

    Raises
    ------
    SceneError
        One of the two is damaged; or a layer names something that cannot be read, or has metadata that make no sense,
        and warnings are errors.
    """
    documents: list[tuple[Sdf.Layer, str, str]] = []
    with Sdf.ChangeBlock():  # else other stages of these layers are composed of what is then left out again
        listed = _read_all(root, session, documents, warnings)
        _CHANGED.update(leave_out_clips(listed.items(), why_no_layer, warnings))
    for layer, name, path in documents:  # whose translation is composed
        _change(layer, name, _translated(path, warnings))
    return listed


def _read_all(
    root: Sdf.Layer, session: Sdf.Layer, documents: list[tuple[Sdf.Layer, str, str]], warnings: Warnings
) -> dict[Sdf.Layer, list[Sdf.Path]]:
    """Return the prims of two layers and of all that they refer to; list MaterialX documents, and what names them."""
    listed = {layer: _prims(layer) for layer in map(_as_in_file, (root, session))}
    waiting = [(layer, root.expressionVariables) for layer in listed]
    known = {layer.identifier for layer in listed}

    def leave_out(layer: Sdf.Layer, name: str, problem: object) -> None:
        warnings.lack(f"{layer.realPath or layer.identifier} refers to {name}: {problem}; it is left out")
        _change(layer, name, "")

    while waiting:
        layer, variables = waiting.pop()
        variables = {**layer.expressionVariables, **variables}
        if correct_metadata(layer, warnings) | _leave_out_claims(layer, warnings):
            _CHANGED.add(layer.identifier)
        for name in layer.GetCompositionAssetDependencies():
            path, arguments = resolved_name(layer, name, variables)
            identifier = Sdf.Layer.CreateIdentifier(path, arguments)
            if not path or identifier in known:
                continue
            problem = why_no_layer(path)
            if problem and not os.path.isdir(path):
                leave_out(layer, name, f"expected a file, {problem}")
                continue
            if path.endswith(".mtlx") and not Sdf.FileFormat.FindByExtension("mtlx"):
                documents.append((layer, name, path))
                continue
            try:
                if other := read_layer(identifier):
                    listed[other] = _prims(_as_in_file(other))
                    waiting.append((other, variables))
                    known.add(identifier)
            except Tf.ErrorException:  # composition reports it, if it needs this layer
                continue
            except SceneError as error:
                leave_out(layer, name, error)
    return listed


def _prims(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the paths of a layer's prims and variants.

    Raises
    ------
    SceneError
        A binary layer lists prims that it does not hold: it is damaged, and OpenUSD would abort the process.
    """
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    prims = [path for path in paths if path.IsPrimPath() or path.IsPrimVariantSelectionPath()]
    name = layer.realPath or layer.identifier
    if not all(paths) or not all(specs := [*map(layer.GetObjectAtPath, prims)]):
        raise SceneError(f"{name} is damaged: it lists prims that it does not hold")
    try:
        str(layer.documentation)
        for spec in specs:
            getattr(spec, "typeName", None)  # variants have none
    except UnicodeDecodeError as error:
        text = error.object[:60].decode(errors="replace")
        raise SceneError(f"{name} has the text {text!r}: expected UTF-8") from None
    return prims


def read_layer(path: str) -> Sdf.Layer | None:
    """Return the layer of a file, or None; Tf.ErrorException if it claims to hold far more than its size tells."""
    outer = Ar.SplitPackageRelativePathOuter(path)[0]
    with bounded(_LEAST_ROOM + _SPEC_ROOM * (os.path.getsize(outer) if os.path.isfile(outer) else 0)):
        return Sdf.Layer.FindOrOpen(path)


def _leave_out_claims(layer: Sdf.Layer, warnings: Warnings) -> bool:
    """Remove the arrays of a small binary layer, with a warning, that claim to be larger than memory; return whether.

    OpenUSD allocates what an array claims, as soon as anybody reads it.
    """
    outer = Ar.SplitPackageRelativePathOuter(layer.realPath)[0] if layer.realPath else ""
    if not os.path.isfile(outer) or os.path.getsize(outer) > _SMALL:
        return False
    with opened(outer) as file:
        if file.read(1) == b"#":  # a text holds what it says
            return False
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    wrong = []
    with bounded(_LEAST_ROOM):
        for spec in map(layer.GetAttributeAtPath, filter(Sdf.Path.IsPropertyPath, paths)):
            try:
                if spec and spec.typeName.isArray:
                    _ = spec.default, *(layer.QueryTimeSample(spec.path, each) for each in spec.ListTimeSamples())
            except (Tf.ErrorException, MemoryError):
                wrong.append(spec)
    for spec in wrong:
        text = f"{spec.path} claims more values than memory holds, or is damaged: expected an array that can be read"
        if not layer.permissionToEdit:  # in a package
            raise SceneError(f"{outer}: {text}")
        warnings.give(text, outer, "it is left out")
        spec.owner.RemoveProperty(spec)
    return bool(wrong)


def resolved_name(layer: Sdf.Layer, name: str, variables: Mapping[str, object]) -> tuple[str, dict[str, str]]:
    """Return the path that a layer refers to by a name, "" if there is none, and the arguments of its file format."""
    if Sdf.VariableExpression.IsExpression(name):
        value = Sdf.VariableExpression(name).Evaluate(variables).value
        name = value if isinstance(value, str) else ""
    name, arguments = Sdf.Layer.SplitIdentifier(name)
    return str(Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(name))) if name else "", arguments


def write_layer(layer: Sdf.Layer, path: PathLike) -> None:
    """Write a layer to a .usda, .usdc or .usd file, whole or not at all; raise OSError as `atomic_path` does."""
    if Path(path).suffix == ".usda":
        write_bytes(path, layer.ExportToString().encode())
        return
    with atomic_path(path) as beside:
        try:
            with quiet():
                layer.Export(str(beside))
                sync(beside)
                found = Sdf.Layer.OpenAsAnonymous(str(beside))
        except Tf.ErrorException as error:
            raise failure_of(beside, "; ".join(sentences_of(error)[-1:])) from None
        if not found or _text(found) != _text(layer):
            raise failure_of(beside, "the disk holds another layer")


def _text(layer: Sdf.Layer) -> str:
    """Return a layer as text, without signs of zeros: binary files do not keep those of vectors."""
    return re.sub(r"(?<![\w.])-0(?![\w.])", "0", layer.ExportToString())


def why_no_layer(path: str) -> str:
    """Return why a path, which may lead into a package, cannot be read as a layer; "" if it may be one."""
    most = _MOST_TEXT if path.endswith(".usda") else None  # OpenUSD reads all of a text; binary layers, what it needs
    outer = Ar.SplitPackageRelativePathOuter(path)[0]
    problem = why_unreadable(outer, most)
    try:
        if not problem and any(map(is_deep, _texts(outer))):
            return f"it nests braces more than {DEEPEST:,} deep"
    except UnicodeDecodeError as error:
        return f"it holds {error.object[:60].decode(errors='replace')!r}: expected names in UTF-8"
    return problem


def _texts(path: str) -> Iterator[bytes]:
    """Yield the text of a layer, or those of the layers in a package; a binary layer has none."""
    with opened(path) as file:
        start = file.read(2)
        if start[:1] == b"#":
            yield start + file.read()
    if start == b"PK" and (package := Sdf.ZipFile.Open(path)):
        names = (name for name in package.GetFileNames() if name.endswith((".usd", ".usda")))
        yield from (data for name in names if (data := package.GetFile(name))[:1] == b"#")


def _as_in_file(layer: Sdf.Layer) -> Sdf.Layer:
    """Return a layer, read again from its file if it was changed for an earlier stage."""
    if layer.identifier in _CHANGED:
        layer.Reload(force=True)
        _CHANGED.remove(layer.identifier)
    return layer


def _translated(path: str, warnings: Warnings) -> str:
    """Return the identifier of the translation of a MaterialX document, or "", with a warning."""
    try:
        return str(_document(path, stamp(path)).identifier)
    except SceneError as error:
        warnings.lack(f"{error}; it is left out")
        return ""


def _change(layer: Sdf.Layer, name: str, other: str) -> None:
    """Make a layer name another one, in memory only, or none if `other` is ""."""
    if layer.permissionToEdit:
        for _ in range(2):  # of a sublayer that is also referred to, OpenUSD updates one at a time
            layer.UpdateCompositionAssetDependency(name, other)
        _CHANGED.add(layer.identifier)


# Kept for the life of the process, because layers of other stages may name a translation.
@cache
def _document(path: str, _stamp: tuple[int, int]) -> Sdf.Layer:
    return materialx.layer_of(path)
