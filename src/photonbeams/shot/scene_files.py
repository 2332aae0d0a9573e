"""Checks of files and dictionaries that Mitsuba scenes refer to, before Mitsuba reads them.

Mitsuba opens whatever a scene names: it waits forever for a named pipe, reads a device until memory ends, and allocates
what the header of a file claims. Some data, such as a grid without cells, make it end the process.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..images.files import check_decoded, check_image, pixels_of
from ..images.files import opened as opened_image
from ..runtime.device import helping_thread, mitsuba
from ..runtime.inputs import MOST_TEXT, check_size, content, is_special, opened
from ..scene import SceneError, shown
from ..volumes.vol import vol_shape
from .old_scenes import parse

#: What messages about a scene that is a dictionary begin with.
OF_DICTIONARIES = "a scene's dictionary"

_ATTRIBUTE = re.compile(r"""([\w:.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_ELEMENT = re.compile(r"<\s*(/?\w+)((?:[^<>\"']|\"[^\"]*\"|'[^']*')*)>")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_NUMBERS = re.compile(r"[-+\d\s.,eE]+")
_SURROGATE = re.compile("[\ud800-\udfff]")  # stands for a byte that is no text
_LONGEST = 4096  # of a path
_DEEPEST = 200  # elements in elements, or objects in objects: Mitsuba needs a part of the stack for each
_MOST_OBJECTS = 1_000_000  # in a dictionary: Mitsuba makes shared ones as often as they are held
_MOST_FILES = 1000  # that a scene includes, directly or through others
_MOST_HEADER = 1 << 20  # bytes of a mesh's header
_MOST_LOBES = 1000
_OF_BITMAPS = ("filename", "bitmap", "data")  # without one of these, Mitsuba ends the process
_ROWS = ("centers", "scales", "quaternions")  # of ellipsoids, in rows: of other tensors, Mitsuba ends the process, too
_IMAGES = ("bitmap", "envmap", "projector", "volume")
_GRIDS = ("gridvolume", "sdfgrid")
_MESHES = ("obj", "ply", "serialized")
_PLY = ("ply", "ellipsoids", "ellipsoidsmesh")

# Types of PLY files, as NumPy names them; and the corners of faces, of which Mitsuba reads three each.
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_CORNERS = ("vertex_index", "vertex_indices")
_SERIALIZED = struct.Struct("<HH")  # the magic number and the version
_COUNTS = struct.Struct("<2Q")  # of vertices and of triangles
# Numbers of a vertex by the flags of a serialized mesh: its position, a normal, a texture coordinate, a colour.
_OF_VERTEX = {0: 3, 0x0001: 3, 0x0002: 2, 0x0008: 3}
_DOUBLE = 0x2000  # the flag of numbers of 8 bytes, not 4
_MOST_ZIPPED = 1032  # how much smaller zlib makes data at most


def check_files(path: Path, parameters: Mapping[str, str]) -> None:
    """Check the files that a scene refers to. Those that do not exist are left to Mitsuba.

    SceneError for one that cannot be read, or that claims to hold more than there is, or more than can be read.
    """
    folders = [path.parent, *named_files(path, parameters).folders]
    _check_parsed(path, parse(path, parameters).state, folders)


class _SceneDictionary(NamedTuple):
    """A dictionary as Mitsuba takes it, how many there are in it, each as often as it is held, and how deep."""

    source: Mapping[str, Any]  # kept alive, and so its id unique
    values: dict[str, Any]
    dictionaries: int
    depth: int


def checked_dictionary(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene's dictionary for `mi.load_dict`, and check its files as `check_files` does."""
    plain = _plain(description, {})
    if plain.dictionaries > _MOST_OBJECTS:
        text = f"holds {plain.dictionaries:.3g} dictionaries, each counted as often as it is held"
        raise SceneError(f"{OF_DICTIONARIES}: {text}: expected up to {_MOST_OBJECTS:,}")
    mi = mitsuba()
    state = mi.parser.parse_dict(mi.parser.ParserConfig(mi.variant()), plain.values)
    _check_parsed(OF_DICTIONARIES, state, [Path(str(each)) for each in mi.file_resolver()])
    return plain.values


def _plain(
    source: Mapping[str, Any], known: dict[int, _SceneDictionary], names: tuple[str, ...] = ()
) -> _SceneDictionary:
    """Return a dictionary of plain ones; SceneError for endless nesting, or values on which Mitsuba would crash.

    What is `known` by its id is not walked again: dictionaries that share others may hold them very often.
    """
    found = known.get(id(source))
    if len(names) + (found.depth if found else 0) > _DEEPEST:
        raise SceneError(f"{OF_DICTIONARIES}: holds objects in objects, more than {_DEEPEST} deep: expected fewer")
    if found is not None:
        return found
    values: dict[str, Any] = {}
    inner: list[_SceneDictionary] = []
    for name, given in source.items():
        value = os.fspath(given) if isinstance(given, os.PathLike) else given
        if problem := _problem_of(name, value):
            place = ".".join((*names, str(name))).encode("utf-8", "backslashreplace").decode()
            raise SceneError(f"{OF_DICTIONARIES}: {place} {problem}")
        if isinstance(value, Mapping):
            inner.append(_plain(value, known, (*names, str(name))))
        values[name] = inner[-1].values if isinstance(value, Mapping) else value
    depth = max((1 + each.depth for each in inner), default=0)
    known[id(source)] = _SceneDictionary(source, values, 1 + sum(each.dictionaries for each in inner), depth)
    return known[id(source)]


def _problem_of(name: object, value: object) -> str:
    """Return what is wrong with a value of a dictionary, a clause, or "" if Mitsuba can tell."""
    if value is None:
        return "is None: expected a value, or leave it out"
    if isinstance(value, list | tuple) and any(each is None for each in value):
        return f"is {shown(value)}: expected no None in it"
    if name in ("type", "id") and not isinstance(value, str):
        return f"is {shown(value)}: expected text"
    if 0 in (shape := _shape(value)):
        return f"is empty, of the shape {shape}: expected one number or more"
    if isinstance(value, mitsuba().Mesh):
        from ..world.checks import wrong_mesh

        return (problem := wrong_mesh(value)) and f"is a mesh, but {problem}: expected faces of its own finite vertices"
    if name in _ROWS and len(shape) < 2:
        return f"is of the shape {shape}: expected a tensor with a row for each ellipsoid"
    texts = (each for each in (name, value) if isinstance(each, str))
    return "is not in UTF-8: expected text" if any(map(_SURROGATE.search, texts)) else ""


def _shape(value: Any) -> tuple[int, ...]:
    """Return the shape of an array, or of an image or a grid of Mitsuba's, () for other values."""
    mi = mitsuba()
    if isinstance(value, mi.Bitmap | mi.VolumeGrid):
        return (*value.size(), value.channel_count())
    return tuple(getattr(value, "shape", ()))


def _check_parsed(path: Path | str, state: Any, folders: Sequence[Path]) -> None:
    """Check the objects of a parsed scene, and their files, which are in folders."""
    _check_nesting(path, state)
    for node in state.nodes:
        properties = node.props
        if properties.plugin_name() == "bitmap" and not any(each in properties for each in _OF_BITMAPS):
            raise SceneError(f"{path}: a bitmap {properties.id()} names no file: expected a filename")
        for file in _found(str(properties["filename"]), folders) if "filename" in properties else ():
            try:
                _check(properties, file)
            except SceneError as error:
                problem = getattr(error, "problem", error)
                raise SceneError(f"{path}: names {file}: expected a file that can be read, but {problem}") from None


class NamedFiles(NamedTuple):
    """The files of a scene: itself, and all that it and the files that it includes name; and folders to look in."""

    files: Collection[Path]
    folders: Sequence[Path]


def named_files(path: Path, parameters: Mapping[str, str]) -> NamedFiles:
    """Return the files that a scene names, and the folders in which Mitsuba looks for them.

    A pipe or device is refused wherever it is named. Other text may have the name of a folder by chance.
    """
    folders: list[Path] = []
    todo, files = [path], {path: None}
    for file in todo:  # which grows meanwhile
        named = "" if file == path else f" includes {file}:"
        try:
            text = _COMMENT.sub("", content(file, MOST_TEXT).decode("utf-8", "replace"))
        except SceneError as error:
            raise SceneError(f"{path}:{named} expected a Mitsuba scene that can be read, but {error}") from None
        values, depth = dict(parameters), 0  # elements around one
        for kind, rest in _ELEMENT.findall(text):
            own = {name: _filled(first or second, values) for name, first, second in _ATTRIBUTE.findall(rest)}
            if not rest.endswith("/"):
                depth += -1 if kind[0] == "/" else 1
            if depth > _DEEPEST:
                raise SceneError(f"{path}:{named} nests elements more than {_DEEPEST} deep: expected fewer")
            if kind == "default":
                values.setdefault(own.get("name", ""), own.get("value", ""))
            for value in own.values():
                for found in _found(value, [file.parent, *folders]):
                    if problem := is_special(found):
                        raise SceneError(f"{path}: names {value}: expected a file, but {problem}")
                    if found.is_file():
                        files[found] = None
            if kind == "path":
                folders += [each for each in _found(own.get("value", ""), [file.parent, *folders]) if each.is_dir()]
            if kind == "include":
                todo += list(_found(own.get("filename", ""), [file.parent, *folders]))[:1]
                if len(todo) > _MOST_FILES:
                    raise SceneError(
                        f"{path}: includes more than {_MOST_FILES:,} files, such as {file}: expected fewer"
                    )
    return NamedFiles(files.keys(), folders)


def _check_nesting(path: Path | str, state: Any) -> None:
    """Check how deep the objects of a scene are in others, also by references, and how many lobes its BSDFs have.

    A BSDF has the lobes of those in it, and one that is two-sided has them twice, so that their number may explode.
    """
    nodes, bsdf = state.nodes, mitsuba().ObjectType.BSDF
    within = {number: [*_children(node, state.id_to_index)] for number, node in enumerate(nodes)}
    depths, lobes = [1] * len(nodes), [0] * len(nodes)
    with suppress(CycleError):  # an object that holds itself, which Mitsuba reports
        for number in TopologicalSorter(within).static_order():  # each after those that it holds
            inner = within[number]
            depths[number] += max((depths[each] for each in inner), default=0)
            if nodes[number].type == bsdf:
                sides = 1 + (nodes[number].props.plugin_name() == "twosided")
                lobes[number] = sides * max(sum(lobes[each] for each in inner), 1)
    if max(depths) > _DEEPEST:
        raise SceneError(f"{path}: holds objects in objects, more than {_DEEPEST} deep: expected fewer")
    if max(lobes) > _MOST_LOBES:
        raise SceneError(f"{path}: a bsdf holds others, {max(lobes):.3g} in all: expected up to {_MOST_LOBES:,}")


def _children(node: Any, numbers: Mapping[str, int]) -> Iterator[int]:
    """Yield the numbers of the objects in an object of a parsed scene."""
    for name, value in node.props.items():
        kind = node.props.type(name).name
        if kind == "ResolvedReference":
            yield value.index()
        elif kind == "Reference" and value.id() in numbers:
            yield numbers[value.id()]


def _filled(text: str, values: Mapping[str, str]) -> str:
    """Return text with the values of parameters in place of their names, $name."""
    for name in sorted(values, key=len, reverse=True):
        text = text.replace(f"${name}", str(values[name]))
    return text


def _found(name: str, folders: Sequence[Path]) -> Iterator[Path]:
    """Yield what exists under a name in folders, or in the working folder."""
    if not name or len(name) > _LONGEST or "\0" in name or _NUMBERS.fullmatch(name):
        return
    for each in dict.fromkeys(folder / name for folder in (*folders, Path())):
        if os.path.exists(each):
            yield each


def _check(properties: Any, file: Path) -> None:
    """Check a file that a plugin reads; raise SceneError, a clause about it."""
    kind = properties.plugin_name()
    index = properties.get("shape_index", 0)
    index = index if isinstance(index, int) else 0  # Mitsuba refuses anything else
    triangles = None
    with opened(file) as data:
        if kind in _GRIDS:
            check_size(12.0 * np.prod(vol_shape(data), dtype=float), np.inf, "its grid")  # Mitsuba makes copies
        elif kind in _PLY:
            _check_ply(data)
        elif kind == "serialized":
            _check_serialized(data, index)
        elif kind == "obj":
            triangles = _triangles(data)
    if kind in _MESHES:
        _check_mesh({"type": kind, "filename": str(file), **({"shape_index": index} if index else {})}, triangles)
    if kind in _IMAGES:
        with opened_image(file) as image:
            spec = image.spec()
            check_image(file, spec)
            check_decoded(file, 2.0 * pixels_of(spec) * max(spec.nchannels, 4))


def _check_ply(data: BinaryIO) -> None:
    """Check that a PLY file is one, and as long as its header says."""
    size = os.fstat(data.fileno()).st_size
    header, marker, rest = data.read(_MOST_HEADER).partition(b"end_header")
    lines = [line.split() for line in header.decode("latin-1").splitlines()]
    if not marker or not lines or lines[0] != ["ply"]:
        raise SceneError("it is no PLY file")
    binary = any(line[:2] in (["format", "binary_little_endian"], ["format", "binary_big_endian"]) for line in lines)
    needed, count = 0, 0
    for line in lines:
        if line[:1] == ["element"]:
            if len(line) != 3 or not re.fullmatch("[0-9]+", line[2]):
                raise SceneError(f"its header has the line {' '.join(line)[:60]!r}: expected a name and a whole number")
            count = int(line[2])
            needed += 0 if binary else 2 * count  # a digit and a line's end
        elif line[:1] == ["property"] and binary:
            kind = _TYPES.get(line[2 if line[1:2] == ["list"] else 1] if len(line) > 2 else "", "u1")
            needed += count * np.dtype(kind).itemsize
    if needed > size:
        raise SceneError(f"its header is of {needed:,} bytes or more, but it has {size:,}")
    data.seek(len(header) + len(marker) + len(rest.partition(b"\n")[0]) + 1)
    if (least := _least_corner(lines, data.read())) < 0:
        raise SceneError(f"a face names vertex {least}: expected 0 or more")


def _least_corner(lines: Sequence[Sequence[str]], body: bytes) -> int:
    """Return the least vertex that faces of a PLY file name, which Mitsuba takes for 0 if it is negative.

    It is 0, too, where the file cannot be read, which Mitsuba reports.
    """
    order = ">" if ["format", "binary_big_endian"] in (line[:2] for line in lines) else "<"
    records: list[tuple[int, list[Any]]] = []
    place = least = 0
    with suppress(IndexError, KeyError, ValueError):
        if any(line[:2] == ["format", "ascii"] for line in lines):
            body, order = np.array(body.split(), dtype=float).tobytes(), ""
        for first, *words in filter(None, lines):
            if first == "element":
                records.append((int(words[-1]), []))
            elif first == "property":
                *kinds, name = words
                codes = [f"{order}{_TYPES[each]}" if order else "f8" for each in kinds if each != "list"]
                records[-1][1].extend(
                    [(f"size of {name}", codes[0]), (name, codes[1], (3,))] if codes[1:] else [(name, codes[0])]
                )
        for count, fields in records:
            rows = np.frombuffer(body, fields, count, place)
            place += rows.nbytes
            for name in {*_CORNERS}.intersection(rows.dtype.names or ()):
                if np.all(rows[f"size of {name}"] == 3):
                    least = min(least, int(rows[name].min(initial=0)))
    return least


def _triangles(data: BinaryIO) -> int:
    """Return the number of triangles that the faces of an OBJ file make; SceneError if a mark hides its first line."""
    first = data.readline().partition(b"#")[0].strip()
    if first.startswith(BOM_UTF8) and first != BOM_UTF8:
        raise SceneError("its first line begins with a byte order mark, which hides it: expected UTF-8 without one")
    data.seek(0)
    faces = (line.partition(b"#")[0].split() for line in data if line.lstrip()[:1] == b"f")
    return sum(max(len(words) - 3, 0) for words in faces if words[0] == b"f")


def _check_serialized(data: BinaryIO, index: int) -> None:
    """Check that a mesh in Mitsuba's own format, the one with this number, has about as many triangles as it says."""
    size = os.fstat(data.fileno()).st_size
    start = data.read(_SERIALIZED.size)
    if len(start) < _SERIALIZED.size or _SERIALIZED.unpack(start)[0] != 0x041C:
        raise SceneError("it is no serialized mesh")
    version = _SERIALIZED.unpack(start)[1]
    if index > 0:
        data.seek(_offset(data, index, "<Q" if version >= 4 else "<I") + _SERIALIZED.size)
    stream = _decompressed(data)
    plain = next(stream, b"")
    first = 4 + (plain.find(b"\0", 4) - 3 if version >= 4 else 0)
    if len(plain) < first + _COUNTS.size:
        raise SceneError("it ends too early")
    vertices, triangles = _COUNTS.unpack_from(plain, first)
    what = f"its mesh of {vertices:,} vertices and {triangles:,} triangles"
    check_size(12.0 * (vertices + triangles), float(_MOST_ZIPPED * size), what)
    (flags,) = struct.unpack_from("<I", plain)
    numbers = sum(count for flag, count in _OF_VERTEX.items() if flags & flag == flag)
    needed = first + _COUNTS.size + vertices * numbers * (8 if flags & _DOUBLE else 4) + 12 * triangles
    found = len(plain)
    while found < needed:
        if not (more := len(next(stream, b""))):
            raise SceneError(f"{what} needs {needed:,} bytes, but it has {found:,}")
        found += more


def _decompressed(data: BinaryIO) -> Iterator[bytes]:
    """Yield the bytes that begin here and were compressed by zlib, some at a time; SceneError if they were not."""
    decompressor = zlib.decompressobj()
    try:
        while not decompressor.eof and (packed := decompressor.unconsumed_tail or data.read(_MOST_HEADER)):
            yield decompressor.decompress(packed, _MOST_HEADER)
    except zlib.error:
        raise SceneError("it cannot be decompressed") from None


def _offset(data: BinaryIO, index: int, kind: str) -> int:
    """Return where the mesh with this number begins, from the table at the end of a file."""
    size, number = os.fstat(data.fileno()).st_size, struct.Struct(kind)
    data.seek(-4, os.SEEK_END)
    (count,) = struct.unpack("<I", data.read(4))
    if not index < count <= size // number.size:
        raise SceneError(f"it has {count:,} meshes: expected one with the number {index}")
    data.seek(-4 - number.size * (count - index), os.SEEK_END)
    (found,) = number.unpack(data.read(number.size))
    if found >= size:
        raise SceneError(f"its mesh {index} begins at byte {found:,}, but it has {size:,}")
    return int(found)


def _check_mesh(description: dict[str, object], triangles: int | None) -> None:
    """Check a mesh, as Mitsuba reads it, and how many triangles that has; what Mitsuba cannot read is left to it.

    Mitsuba computes normals, and a scene its boxes, from any vertex that a face names. Without normals, it only reads.
    """
    from ..world.checks import wrong_mesh

    mi = mitsuba()
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)  # what it warns of, it will say again
    try:
        with suppress(RuntimeError), helping_thread():
            # No name is left for the mesh: an error's traceback would keep it, and later kernels would read it.
            if problem := wrong_mesh(mi.load_dict({**description, "face_normals": True}), triangles):
                raise SceneError(problem)
    finally:
        mi.set_log_level(level)
