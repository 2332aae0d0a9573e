"""Translate MaterialX documents to USD layers: surface materials under /MaterialX/Materials, as OpenUSD's plug-in."""

from __future__ import annotations

import re
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
_COLORED = ("filename", "color3", "color4")


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
        graphs = document.getNodeGraphs()  # without those of the library
        document.setDataLibrary(_library())
        names = {graph.getName() for graph in graphs}
        for each in (document, *graphs):  # nodes of the document's own definitions become what defines them
            each.flattenSubgraphs(filter=partial(_is_defined_by, names))
    except Exception as error:  # MaterialX has a class for each of its errors
        raise SceneError(f"{path} cannot be read: expected a MaterialX document ({error})") from None
    layer = Sdf.Layer.CreateAnonymous(f"{Path(path).name}.usda")
    stage = Usd.Stage.Open(layer)
    stage.SetDefaultPrim(stage.DefinePrim("/MaterialX"))
    for node in document.getMaterialNodes():
        _Translation(stage, path, document).write(node)
    return layer


def _is_defined_by(graphs: set[str], node: MaterialX.Node) -> bool:
    """Return whether a node is implemented by one of these graphs."""
    implementation = node.getImplementation()
    return implementation is not None and implementation.getName() in graphs


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
    """Writes one material of a document to a stage."""

    def __init__(self, stage: Usd.Stage, path: str, document: MaterialX.Document) -> None:
        self._stage, self._path, self._document = stage, path, document
        self._known: dict[tuple[str, Sdf.Path], Any] = {}

    def write(self, node: MaterialX.Node) -> None:
        """Write a material with its surface shader and everything connected to it."""
        material = UsdShade.Material.Define(self._stage, f"/MaterialX/Materials/{_valid(node.getName())}")
        surface = node.getInput("surfaceshader")
        source = None if surface is None else self._source(surface, material)
        if source:
            material.CreateSurfaceOutput("mtlx").ConnectToSource(source)

    def _source(self, element: MaterialX.PortElement, around: UsdShade.NodeGraph) -> Any:
        """Return what an input or an output of the document, within a graph or a material, is connected to, or None."""
        if element.getInterfaceName():
            return around.GetInput(element.getInterfaceName())
        if graph := self._document.getNodeGraph(element.getNodeGraphString()):
            return self._of_graph(graph, element.getOutputString(), around)
        node = element.getConnectedNode() if element.getNodeName() else None
        return None if node is None else self._of_node(node, element.getOutputString(), around)

    def _of_graph(self, graph: MaterialX.NodeGraph, output: str, around: UsdShade.NodeGraph) -> UsdShade.Output | None:
        """Return an output of a graph, the first by default."""
        key = (graph.getNamePath(), around.GetPath())
        if key not in self._known:
            self._known[key] = made = UsdShade.NodeGraph.Define(self._stage, self._free(around, graph.getName()))
            for each in graph.getInputs():
                self._set(made, each, around)
            for each in graph.getOutputs():
                source = self._source(each, made)
                if source:
                    made.CreateOutput(each.getName(), Sdf.ValueTypeNames.Token).ConnectToSource(source)
        names = [each.getName() for each in graph.getOutputs()]
        return self._known[key].GetOutput(output if output in names else names[0]) if names else None

    def _of_node(self, node: MaterialX.Node, output: str, around: UsdShade.NodeGraph) -> UsdShade.Output:
        definition, key = node.getNodeDef(), (node.getNamePath(), around.GetPath())
        if key not in self._known:
            self._known[key] = shader = UsdShade.Shader.Define(self._stage, self._free(around, node.getName()))
            shader.SetShaderId(definition.getName() if definition else f"ND_{node.getCategory()}_{node.getType()}")
            for each in node.getInputs():
                self._set(shader, each, around)
        return self._known[key].CreateOutput(output or "out", Sdf.ValueTypeNames.Token)

    def _free(self, around: UsdShade.NodeGraph, name: str) -> Sdf.Path:
        """Return a path for a new prim in a graph or a material."""
        path = around.GetPath().AppendChild(_valid(name))
        return path.ReplaceName(f"{path.name}_{len(self._known)}") if self._stage.GetPrimAtPath(path) else path

    def _set(self, made: Any, element: MaterialX.Input, around: UsdShade.NodeGraph) -> None:
        """Set or connect an input of a shader or a graph."""
        kind = _TYPES.get(element.getType())
        if kind is None:
            return
        source, text = self._source(element, around), element.getValueString()
        if source:
            made.CreateInput(element.getName(), kind).ConnectToSource(source)
            return
        converted = self._converted(element.getType(), element.getResolvedValueString()) if text else None
        if converted is None:
            return
        own = made.CreateInput(element.getName(), kind)
        own.Set(converted)
        # The document's own colour space does not apply to files: 8-bit files are sRGB by default, as elsewhere.
        space, is_file = element.getActiveColorSpace(), element.getType() == "filename"
        if space and element.getType() in _COLORED and not (is_file and space == self._document.getColorSpace()):
            own.GetAttr().SetColorSpace(space)

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
