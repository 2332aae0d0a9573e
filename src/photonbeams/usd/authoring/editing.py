"""Change values on an open stage: by overrides, which are written as text, and by a layer that is edited."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from enum import IntEnum
from math import isfinite
from pathlib import Path
from typing import Any

from ...runtime.files import check_kept
from ...scene import SceneError, shown
from ..common.openusd import Ar, Gf, Sdf, Sdr, Tf, Usd, UsdGeom, UsdShade, UsdUtils
from ..common.reading import file_of, quiet
from ..layers.writing import why_no_layer, write_layer
from ..lights.light import is_light

#: An empty layer, as text.
EMPTY = "#usda 1.0\n"

# Attributes of lights and cameras that change the extent of the scene.
_EXTENTS = ("xformOp", "visibility", "inputs:radius", "inputs:width", "inputs:height", "inputs:length")

_LARGEST_HALF = 65504.0


class Extent(IntEnum):
    """What a change of a stage may have affected; each kind includes those before it."""

    LOOKS = 0
    VALUES = 1  # values of lights, cameras and media, except their places
    PLACES = 2  # the extent of the scene
    SURFACES = 3  # which gprims are surfaces, and which are media
    ALL = 4


def extent_of(notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> Extent:
    """Return what a notice `Usd.Notice.ObjectsChanged` may have affected on a stage."""
    found = Extent.LOOKS
    for path in notice.GetResyncedPaths():
        found = max(found, _extent(stage, path) if path.IsPropertyPath() else _extent_of_prim(stage, path))
    for path in notice.GetChangedInfoOnlyPaths():
        if path.IsPropertyPath():
            found = max(found, _extent(stage, path))
        elif path == Sdf.Path.absoluteRootPath:
            found = Extent.ALL
    return found


def _extent_of_prim(stage: Usd.Stage, path: Sdf.Path) -> Extent:
    """Return what a new or recomposed prim may have affected: only looks, if it consists of looks and scopes."""
    prim = stage.GetPrimAtPath(path)
    kinds = {str(each.GetTypeName()) for each in Usd.PrimRange(prim, Usd.PrimAllPrimsPredicate)} if prim else {""}
    return Extent.LOOKS if kinds <= {"Scope", "PhotonBeamsLook"} else Extent.ALL


def _extent(stage: Usd.Stage, path: Sdf.Path) -> Extent:
    prim, name = stage.GetPrimAtPath(path.GetPrimPath()), path.name
    if not prim:
        return Extent.ALL
    if prim.GetTypeName() == "PhotonBeamsLook":
        return Extent.LOOKS
    if name.startswith("photonbeams:"):
        return Extent.SURFACES if prim.IsA(UsdGeom.Gprim) else Extent.VALUES
    if prim.IsA(UsdGeom.Camera) or (is_light(prim) and not prim.IsA(UsdGeom.Gprim)):
        return Extent.PLACES if name.startswith(_EXTENTS) else Extent.VALUES
    return Extent.ALL


class EditLayer:
    """A layer over a stage, stronger than all others, that takes values while the stage is open.

    Parameters
    ----------
    stage
        The stage; the layer becomes a sublayer of its session layer.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage, self._layer = stage, Sdf.Layer.CreateAnonymous("edits.usda")
        session = stage.GetSessionLayer()
        self._below = Sdf.Layer.CreateAnonymous("session.usda")  # overrides, which would be stronger than its sublayers
        self._below.TransferContent(session)
        with Sdf.ChangeBlock():
            for prim in list(session.rootPrims):
                del session.rootPrims[prim.name]
            session.subLayerPaths = [self._layer.identifier, self._below.identifier]

    def set(self, path: str, value: object) -> None:
        """Set an attribute, or the targets of a relationship (a list of paths); None removes the layer's own value.

        Raises
        ------
        SceneError
            There is no such prim or attribute, or the value has another type.
        """
        text = f"cannot set {path}"
        if value is None:
            _found(self._stage, path, text)
            self._remove(Sdf.Path(path))
            return

        def targets() -> list[Sdf.Path]:
            if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
                raise SceneError(f"{path} is {shown(value)}: expected a list of paths")
            return _targets(",".join(value), text)

        def converted(kind: Sdf.ValueTypeName) -> Any:
            found = _converted(value, kind, path)
            return self._anchored(found) if isinstance(found, Sdf.AssetPath) else found

        _set(self._stage, self._layer, path, text, targets, converted)

    def leave(self, path: str) -> None:
        """Set an attribute to its default, whatever the stage says.

        Raises
        ------
        SceneError
            There is no such prim or attribute.
        """
        prim, name = _found(self._stage, path, f"cannot set {path}")
        self._remove(Sdf.Path(path))
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():  # by a weaker layer
            with Usd.EditContext(self._stage, self._layer):
                attribute.Block()

    def define(self, path: str, kind: str) -> None:
        """Define a prim of a type, and scopes above it where there is no prim yet.

        Raises
        ------
        SceneError
            There is a prim already, or the stage cannot have one at that path.
        """
        known = Sdf.Path(path)
        if self._stage.GetPrimAtPath(known):
            raise SceneError(f"cannot define {path}: {file_of(self._stage)} has a prim there")
        with Sdf.ChangeBlock():
            for each in known.GetPrefixes():
                prim = self._stage.GetPrimAtPath(each)
                if not (prim and prim.IsDefined()):
                    spec = Sdf.CreatePrimInLayer(self._layer, each)
                    spec.specifier, spec.typeName = Sdf.SpecifierDef, kind if each == known else "Scope"
        if not self._stage.GetPrimAtPath(known):
            raise SceneError(f"cannot define {path}: {file_of(self._stage)} cannot have one there, or does not show it")

    def _anchored(self, asset: Sdf.AssetPath) -> Sdf.AssetPath:
        """Return an asset whose relative path is made absolute, because a layer without a file has no folder."""
        given = asset.path
        return asset if not given or Path(given).is_absolute() else Sdf.AssetPath(str((self._root() / given).resolve()))

    def _root(self) -> Path:
        """Return the stage's folder."""
        return Path(os.path.abspath(self._stage.GetRootLayer().realPath or ".")).parent

    def _remove(self, path: Sdf.Path) -> None:
        spec = self._layer.GetPropertyAtPath(path)
        if spec is not None:
            edit = Sdf.BatchNamespaceEdit()
            edit.Add(path, Sdf.Path.emptyPath)
            self._layer.Apply(edit)
            self._layer.RemoveInertSceneDescription()

    def paths(self) -> list[str]:
        """Return the paths of the properties that the layer sets."""
        return [str(path) for path in _paths(self._layer) if path.IsPrimPropertyPath()]

    def text(self) -> str:
        """Return the layer as .usda."""
        return str(self._layer.ExportToString())

    def replace(self, text: str) -> None:
        """Replace the content by that of a layer given as .usda text; on a SceneError nothing is changed."""
        if not _read(lambda: self._layer.ImportFromString(text)):
            raise SceneError("the text is not a USD layer")

    def load(self, path: Path) -> None:
        """Replace the content by that of a file; SceneError if it is not a USD layer."""
        problem = why_no_layer(str(path))
        layer = None if problem else _read(lambda: Sdf.Layer.OpenAsAnonymous(str(path)))
        if layer is None:
            raise SceneError(f"{path} cannot be read: {problem or 'expected a USD layer'}")
        anchor = Ar.ResolvedPath(os.path.abspath(path))
        UsdUtils.ModifyAssetPaths(layer, lambda name: _absolute(name, anchor))
        self._layer.TransferContent(layer)

    def merge(self, before: str, path: Path) -> None:
        """Replace the content by that of a file, with the changes that were made here since the text `before`.

        Values that both have changed are those of this layer; if `before` is no layer, all of its values are changes.
        SceneError if the file is not a USD layer.
        """
        mine, base = Sdf.Layer.CreateAnonymous(), Sdf.Layer.CreateAnonymous()
        mine.TransferContent(self._layer)
        _read(lambda: base.ImportFromString(before))
        self.load(path)
        for gone in {*_paths(base)} - {*_paths(mine)}:
            self._remove(gone)
        for own in _paths(mine):
            if not own.IsPrimPropertyPath():
                self._add(mine.GetPrimAtPath(own))
            elif _text_at(mine, own) != _text_at(base, own):
                Sdf.CopySpec(mine, own, self._layer, own)

    def _add(self, prim: Sdf.PrimSpec | None) -> None:
        """Add a prim of another layer, without its properties, where there is none."""
        if prim is not None and not self._layer.GetPrimAtPath(prim.path):
            spec = Sdf.CreatePrimInLayer(self._layer, prim.path)
            spec.specifier, spec.typeName = prim.specifier, prim.typeName

    def write(self, path: Path) -> None:
        """Write the layer to a .usd, .usda or .usdc file, whole or not at all.

        Files in the stage's folder, or else in that of the layer's file, get relative paths.

        Raises
        ------
        SceneError
            The file is one that `check` refuses.
        OSError
            The file cannot be written.
        """
        self.check(path)
        folder, root = Path(os.path.abspath(path)).parent, self._root()
        near = root if folder.is_relative_to(root) else folder

        def relative(name: str) -> str:
            if not Path(name).is_relative_to(near):
                return name
            found = Path(os.path.relpath(name, folder)).as_posix()
            return found if found.startswith("../") else f"./{found}"

        layer = Sdf.Layer.CreateAnonymous()
        layer.TransferContent(self._layer)
        UsdUtils.ModifyAssetPaths(layer, relative)
        write_layer(layer, path)

    def check(self, path: Path) -> None:
        """Raise SceneError for a file that the layer is not written to: the stage's own, or one of another kind."""
        if path.suffix not in (".usd", ".usda", ".usdc"):
            raise SceneError(f"{path}: expected a .usda, .usdc or .usd file")
        check_kept([path], [self._stage.GetRootLayer().realPath])


def _absolute(name: str, anchor: Ar.ResolvedPath) -> str:
    """Return what a file at `anchor` names, from anywhere, because a layer without a file has no folder."""
    return name if Sdf.VariableExpression.IsExpression(name) else Ar.GetResolver().CreateIdentifier(name, anchor)


def _paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the paths of a layer's specs, those of prims before those in them."""
    found: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    return sorted(found)


def _text_at(layer: Sdf.Layer, path: Sdf.Path) -> str | None:
    """Return a property of a layer as text, or None if the layer lacks it."""
    spec = layer.GetPropertyAtPath(path)
    return None if spec is None else str(spec.GetAsText())


def _read(read: Callable[[], Any]) -> Any:
    """Return what OpenUSD reads, or None, instead of its error, if it cannot."""
    try:
        with quiet():
            return read()
    except Tf.ErrorException:
        return None


def _found(stage: Usd.Stage, path: str, text: str) -> tuple[Usd.Prim, str]:
    """Return the prim and the name of a property that may be edited; `text` begins messages."""
    known = Sdf.Path(path) if isinstance(path, str) and Sdf.Path.IsValidPathString(path) else Sdf.Path()
    if not known.IsPrimPropertyPath():
        raise SceneError(f"{text}: expected /prim.attribute=value")
    prim = stage.GetPrimAtPath(known.GetPrimPath())
    if not prim:
        raise SceneError(f"{text}: {file_of(stage)} has no prim {known.GetPrimPath()}")
    if prim.IsInstanceProxy():
        raise SceneError(f"{text}: {_instance(prim)}")
    return prim, known.name


def _set(
    stage: Usd.Stage, layer: Sdf.Layer, path: str, text: str, targets: Callable[[], list[Sdf.Path]],
    converted: Callable[[Sdf.ValueTypeName], object],
) -> None:  # fmt: skip
    """Set a property in a layer: the targets of a relationship, or an attribute to a value converted to its type."""
    try:
        prim, name = _found(stage, path, text)
        if _is_relationship(prim, name):
            paths = targets()
            with Usd.EditContext(stage, layer):
                prim.CreateRelationship(name).SetTargets(paths)
            return
        kind = _type_of(prim, name)
        if kind is None:
            raise SceneError(f"{text}: {prim.GetPath()} has no attribute {name}")
        value = converted(kind)
        with Usd.EditContext(stage, layer):
            prim.CreateAttribute(name, kind).Set(value)
    except SceneError:
        raise
    except (Tf.ErrorException, ValueError) as error:  # text that is not in UTF-8, numbers beyond a type's
        why = " ".join(str(error).split())[-80:]
        raise SceneError(f"{text[:160]!a}: expected text in UTF-8, or a number that its type has ({why!a})") from None


def _converted(value: Any, kind: Sdf.ValueTypeName, path: str) -> Any:
    """Return a number, a text or a list as a value of a USD type; SceneError if it has another type."""
    default = kind.defaultValue
    if kind.isArray:
        if not isinstance(value, list):
            raise SceneError(f"{path} is {shown(value)}: expected a list")
        return [_converted(each, kind.scalarType, path) for each in value]
    if isinstance(default, Gf.Vec2f | Gf.Vec3f | Gf.Vec4f | Gf.Vec2d | Gf.Vec3d | Gf.Vec4d):
        if isinstance(value, list) and len(value) == len(default):
            return type(default)(*(_converted(each, Sdf.ValueTypeNames.Double, path) for each in value))
        raise SceneError(f"{path} is {shown(value)}: expected {len(default)} numbers")
    most = _LARGEST_HALF if kind == Sdf.ValueTypeNames.Half else 3e38
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= most
    expected: dict[type, tuple[str, bool]] = {
        bool: ("true or false", isinstance(value, bool)),
        str: ("a text", isinstance(value, str)),
        Sdf.AssetPath: ("the path of a file", isinstance(value, str)),
        int: ("a whole number", is_number and isinstance(value, int) and abs(value) < 1 << 31),
        float: ("a finite number", is_number),
    }
    if type(default) not in expected:
        raise SceneError(f"{path} is of type {kind}: expected one of numbers, text or files, which can be edited here")
    text, fits = expected[type(default)]
    if not fits:
        raise SceneError(f"{path} is {shown(value)}: expected {text}")
    return type(default)(value)


def override(stage: Usd.Stage, text: str) -> None:
    """Set one attribute, or the targets of a relationship, in the session layer, by a text "/prim.attribute=value".

    Raises
    ------
    SceneError
        The text has another form, there is no such prim or attribute, or the value has another type.
    """
    target, equals, value = (part.strip() for part in text.partition("="))
    message = f"cannot set '{text}'"
    if not equals:
        raise SceneError(f"{message}: expected /prim.attribute=value")
    session = stage.GetSessionLayer()
    _set(stage, session, target, message, lambda: _targets(value, message), lambda kind: _parsed(value, kind, message))


def _instance(prim: Usd.Prim) -> str:
    """Return the message for a value set inside an instance; it names the prim that all instances repeat."""
    root = prim
    while not root.IsInstance():
        root = root.GetParent()
    stage = prim.GetStage()
    layers = stage.GetLayerStack()
    sources = [each.path for each in prim.GetPrimStack() if each.layer in layers]
    found = next((path for path in sources if (own := stage.GetPrimAtPath(path)) and not own.IsInstanceProxy()), None)
    expected = "a prim outside of instances" if found is None else f"{found}, which all its instances repeat"
    return f"{prim.GetPath()} is inside the instance {root.GetPath()}: expected {expected}"


def _type_of(prim: Usd.Prim, name: str) -> Sdf.ValueTypeName | None:
    """Return an attribute's type, also of photonbeams' own if their schema could be applied, and of shaders' inputs."""
    attribute = prim.GetAttribute(name)
    if attribute:
        return attribute.GetTypeName()
    found = (definition.GetAttributeDefinition(name) for definition in _applicable(prim))
    return next((each.GetTypeName() for each in found if each), None) or _type_of_input(prim, name)


def _type_of_input(prim: Usd.Prim, name: str) -> Sdf.ValueTypeName | None:
    """Return the type of an input that a shader has by its kind, as UsdPreviewSurface has an opacity."""
    shader = UsdShade.Shader(prim)
    node = Sdr.Registry().GetShaderNodeByIdentifier(shader.GetShaderId() or "") if shader else None
    found = node.GetShaderInput(name.removeprefix("inputs:")) if node and name.startswith("inputs:") else None
    return found.GetTypeAsSdfType().GetSdfType() if found else None


def _is_relationship(prim: Usd.Prim, name: str) -> bool:
    """Return whether a prim has a relationship, or a schema of photonbeams that could be applied has it."""
    return prim.HasRelationship(name) or any(each.GetRelationshipDefinition(name) for each in _applicable(prim))


def _applicable(prim: Usd.Prim) -> Iterator[Usd.PrimDefinition]:
    """Return photonbeams' own API schemas that could be applied to a prim."""
    registry = Usd.SchemaRegistry()
    for schema in ("PhotonBeamsLightAPI", "PhotonBeamsCurvesAPI", "PhotonBeamsMediumAPI"):
        kinds = registry.GetAPISchemaCanOnlyApplyToTypeNames(schema)
        definition = registry.FindAppliedAPIPrimDefinition(schema)
        if definition and (not kinds or prim.GetTypeName() in kinds):
            yield definition


def _targets(value: str, text: str) -> list[Sdf.Path]:
    """Return the paths, separated by commas, that a relationship is to name; none for an empty text."""
    names = [part.strip().removeprefix("<").removesuffix(">") for part in value.split(",")] if value else []
    for name in names:
        if not Sdf.Path.IsValidPathString(name) or not Sdf.Path(name).IsAbsolutePath():
            raise SceneError(f"{text}: expected the paths of prims, such as /Looks/Soft")
    return [Sdf.Path(name) for name in names]


def _parsed(value: str, kind: Sdf.ValueTypeName, text: str) -> Any:
    """Parse a value written in USD's own notation."""
    if kind in (Sdf.ValueTypeNames.Token, Sdf.ValueTypeNames.String) and not value.startswith(('"', "'")):
        value = f'"{value}"'
    if (
        isinstance(kind.defaultValue, int) and kind != Sdf.ValueTypeNames.Bool and not re.fullmatch(r"[+-]?\d+", value)
    ):  # OpenUSD would ignore the rest
        raise SceneError(f"{text}: expected a whole number")
    if kind == Sdf.ValueTypeNames.Asset and not value.startswith("@"):
        value = f"@{value}@"
    if isinstance(kind.defaultValue, (Gf.Vec3f, Gf.Vec3d)) and value[:1] != "(":
        numbers = value.split(",")
        value = f"({', '.join(numbers * 3 if len(numbers) == 1 else numbers)})"
    layer = Sdf.Layer.CreateAnonymous(".usda")
    parsed = _read(lambda: layer.ImportFromString(f'#usda 1.0\ndef "A"\n{{\n    {kind} v = {value}\n}}\n'))
    spec = layer.GetAttributeAtPath("/A.v") if parsed else None
    if spec is None or spec.default is None:
        raise SceneError(f"{text}: expected a value of type {kind}")
    if isinstance(spec.default, float) and not isfinite(spec.default):
        raise SceneError(f"{text}: expected a finite number")
    return spec.default
