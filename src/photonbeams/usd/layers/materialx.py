"""Translate MaterialX documents to USD layers: surface materials under /MaterialX/Materials, as OpenUSD's plug-in."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...runtime.inputs import MOST_TEXT, why_unreadable
from ...scene import SceneError
from ...scene.extras import needs
from ..common.openusd import Ar, Sdf, Usd, UsdShade
from ..common.textures import asset_content

if TYPE_CHECKING:
    import MaterialX

_TYPES = {
    "float": Sdf.ValueTypeNames.Float, "integer": Sdf.ValueTypeNames.Int, "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f, "color4": Sdf.ValueTypeNames.Color4f,
    "vector2": Sdf.ValueTypeNames.Float2, "vector3": Sdf.ValueTypeNames.Float3,
    "vector4": Sdf.ValueTypeNames.Float4, "string": Sdf.ValueTypeNames.String,
    "filename": Sdf.ValueTypeNames.Asset,
}  # fmt: skip


class _Literal(NamedTuple):
    """A value as in the document (files with their prefix), and its own colour space."""

    kind: str
    text: str
    color_space: str


class _NodeOutput(NamedTuple):
    """An output of a shader that is already on the layer."""

    shader: UsdShade.Shader
    name: str


_Scope = dict[str, "_Literal | _NodeOutput | None"]


def layer_of(path: str) -> Sdf.Layer:
    """Return a MaterialX document as an anonymous layer.

    Raises
    ------
    SceneError
        MaterialX is not installed, or the document cannot be read.
    """
    with needs("materialx", f"{path}, a MaterialX document,", "MaterialX"):
        import MaterialX
    document = MaterialX.createDocument()
    try:
        text = asset_content(path, MOST_TEXT).decode()
        folder = MaterialX.FileSearchPath(str(Path(Ar.SplitPackageRelativePathOuter(path)[0]).parent))
        options = MaterialX.XmlReadOptions()
        options.readXIncludeFunction = _include
        MaterialX.readFromXmlString(document, text, folder, options)
        graphs = frozenset(graph.getName() for graph in document.getNodeGraphs())  # without those of the library
        document.setDataLibrary(_library())
    except Exception as error:  # MaterialX has a class for each of its errors
        raise SceneError(f"{path} cannot be read: expected a MaterialX document ({error})") from None
    layer = Sdf.Layer.CreateAnonymous(f"{Path(path).name}.usda")
    stage = Usd.Stage.Open(layer)
    stage.SetDefaultPrim(stage.DefinePrim("/MaterialX"))
    for node in document.getMaterialNodes():
        _Translation(stage, path, document, graphs).write(node)
    return layer


def _include(
    document: MaterialX.Document, name: MaterialX.FilePath, folders: MaterialX.FileSearchPath,
    options: MaterialX.XmlReadOptions,
) -> None:  # fmt: skip
    """Read a document that another one includes."""
    import MaterialX

    if problem := why_unreadable(folders.find(name).asString(), MOST_TEXT):
        raise SceneError(f"it includes {name.asString()}, but {problem}")
    MaterialX.readFromXmlFile(document, name, folders, options)


@cache
def _library() -> MaterialX.Document:
    """Return MaterialX's own definitions of nodes."""
    import MaterialX

    library = MaterialX.createDocument()
    folders = MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(MaterialX.getDefaultDataLibraryFolders(), folders, library)
    return library


class _Translation:
    """Writes one material of a document to a stage; node graphs and custom definitions are replaced by their nodes."""

    def __init__(self, stage: Usd.Stage, path: str, document: MaterialX.Document, graphs: frozenset[str]) -> None:
        self._stage, self._path, self._document = stage, path, document
        self._own = graphs
        self._shaders: dict[Any, UsdShade.Shader] = {}
        self._scopes: dict[Any, _Scope] = {}

    def write(self, node: MaterialX.Node) -> None:
        """Write a material with its surface shader and everything connected to it."""
        material = UsdShade.Material.Define(self._stage, f"/MaterialX/Materials/{_valid(node.getName())}")
        found = node.getInput("surfaceshader")
        value = None if found is None else self._value(found, {}, material.GetPath())
        if isinstance(value, _NodeOutput):
            surface = material.CreateSurfaceOutput("mtlx")
            surface.ConnectToSource(value.shader.ConnectableAPI(), value.name)

    def _value(self, element: MaterialX.PortElement, scope: _Scope, parent: Sdf.Path) -> _Literal | _NodeOutput | None:
        """Return the value of an input or an output of the document, or what it is connected to."""
        if element.getInterfaceName():
            return scope.get(element.getInterfaceName())
        if element.getNodeGraphString() in self._own:
            graph = self._document.getNodeGraph(element.getNodeGraphString())
            return self._of_graph(graph, element.getOutputString(), scope, parent, graph)
        node = element.getConnectedNode() if element.getNodeName() else None
        if node is not None:
            return self._of_node(node, element.getOutputString(), scope, parent)
        if not element.getValueString():
            return None
        space = element.getActiveColorSpace()
        # The document's own colour space does not apply to files: 8-bit files are sRGB by default, as elsewhere.
        is_file = element.getType() == "filename" and space == self._document.getColorSpace()
        own = space if element.getType() in ("filename", "color3", "color4") and not is_file else ""
        return _Literal(element.getType(), element.getResolvedValueString(), own)

    def _of_graph(
        self, graph: MaterialX.NodeGraph, output: str, scope: _Scope, parent: Sdf.Path,
        inputs: MaterialX.InterfaceElement,
    ) -> _Literal | _NodeOutput | None:  # fmt: skip
        """Return an output of a graph, given the inputs with the values of its interface."""
        outputs = graph.getOutputs()
        chosen = graph.getOutput(output) if output else None
        chosen = chosen or (outputs[0] if outputs else None)
        key = (graph.getNamePath(), inputs.getNamePath(), id(scope))
        if key not in self._scopes:
            inner: _Scope = {each.getName(): self._value(each, {}, parent) for each in graph.getInputs()}
            if inputs is not graph:
                definition = inputs.getNodeDef()
                for each in definition.getInputs() if definition else ():
                    inner[each.getName()] = _Literal(each.getType(), each.getValueString(), "")
                inner.update({each.getName(): self._value(each, scope, parent) for each in inputs.getInputs()})
            self._scopes[key] = inner
        return None if chosen is None else self._value(chosen, self._scopes[key], parent)

    def _of_node(
        self, node: MaterialX.Node, output: str, scope: _Scope, parent: Sdf.Path
    ) -> _Literal | _NodeOutput | None:
        implementation = node.getImplementation()
        if implementation is not None and implementation.getName() in self._own:
            graph = self._document.getNodeGraph(implementation.getName())
            return self._of_graph(graph, output, scope, parent, node)
        key = (node.getNamePath(), id(scope))
        if key not in self._shaders:
            path = parent.AppendChild(_valid(node.getName()))
            if self._stage.GetPrimAtPath(path):  # from another graph
                path = path.ReplaceName(f"{path.name}_{len(self._shaders)}")
            self._shaders[key] = shader = UsdShade.Shader.Define(self._stage, path)
            definition = node.getNodeDef()
            shader.SetShaderId(definition.getName() if definition else f"ND_{node.getCategory()}_{node.getType()}")
            for each in node.getInputs():
                self._set(shader, each, self._value(each, scope, parent))
        shader, name = self._shaders[key], output or "out"
        shader.CreateOutput(name, Sdf.ValueTypeNames.Token)
        return _NodeOutput(shader, name)

    def _set(self, shader: UsdShade.Shader, element: MaterialX.Input, value: _Literal | _NodeOutput | None) -> None:
        """Set or connect an input of a shader."""
        kind = _TYPES.get(element.getType())
        if value is None or kind is None:
            return
        own = shader.CreateInput(element.getName(), kind)
        if isinstance(value, _NodeOutput):
            own.ConnectToSource(value.shader.ConnectableAPI(), value.name)
            return
        converted = self._converted(element.getType(), value.text)
        if converted is not None:
            own.Set(converted)
        if value.color_space:
            own.GetAttr().SetColorSpace(value.color_space)

    def _converted(self, kind: str, text: str) -> Any:
        """Convert a value of the document to USD, with the full path of a file; None if it is broken."""
        if kind == "filename":
            return Sdf.AssetPath(str(Ar.GetResolver().CreateIdentifier(text, Ar.ResolvedPath(self._path))))
        if kind == "string":
            return text
        if kind == "boolean":
            return text == "true"
        try:
            numbers = tuple(float(each) for each in re.split(r"[\s,]+", text.strip()))
        except ValueError:
            return None
        if len(numbers) != int(kind[-1]) if kind[-1].isdigit() else len(numbers) != 1:
            return None
        return int(numbers[0]) if kind == "integer" else numbers if len(numbers) > 1 else numbers[0]


def _valid(name: str) -> str:
    return re.sub(r"\W", "_", name) or "node"
