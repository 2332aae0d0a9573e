"""Write page/src/protocol.ts, the messages between page and studio as types, from src/photonbeams/studio/protocol.py.

Usage: python tools/protocol.py. A test compares the committed file with what this writes.
"""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from photonbeams.studio import protocol

FILE = Path(__file__).parents[1] / "page" / "src" / "protocol.ts"
HEAD = """/** The messages between page and server, as types. Written by tools/protocol.py: do not edit. */
"""
PLAIN = {str: "string", int: "number", float: "number", bool: "boolean", NoneType: "null", Any: "Value"}
ALIASES = {each: getattr(protocol, each) for each in ("Triple", "Eyes", "Area")}


def typescript(kind: Any, name: str = "") -> str:
    """Return a type in TypeScript; `name` is the alias that is being defined."""
    for alias, aliased in ALIASES.items():
        if kind == aliased and alias != name:
            return alias
    origin, given = get_origin(kind), [each for each in get_args(kind) if each is not msgspec.UnsetType]
    if kind in PLAIN:
        return PLAIN[kind]
    if origin is Literal:
        return " | ".join(f'"{each}"' for each in given)
    if origin in (Union, UnionType):
        return " | ".join(dict.fromkeys(typescript(each) for each in given))
    if origin is list or (origin is tuple and given[-1] is Ellipsis):
        inner = typescript(given[0])
        return f"({inner})[]" if " | " in inner else f"{inner}[]"
    if origin is tuple:
        return f"[{', '.join(typescript(each) for each in given)}]"
    if origin is dict and given[1] is Any:
        return "Values"
    if origin is dict:
        return f"Record<string, {typescript(given[1])}>"
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind.__name__
    raise TypeError(f"{kind} has no TypeScript")


def interface(struct: type[msgspec.Struct]) -> str:
    """Return a struct as an interface; fields with a default may be missing."""
    comment = inspect.cleandoc(struct.__doc__ or "").split("\n")
    doc = [f" * {each}".rstrip() for each in comment] if len(comment) > 1 else []
    lines = ["/**", *doc, " */"] if doc else [f"/** {comment[0]} */"]
    lines += [f"export interface {struct.__name__} {{"]
    if isinstance(tag := struct.__struct_config__.tag, str):
        lines.append(f'  {struct.__struct_config__.tag_field}: "{tag}";')
    kinds = get_type_hints(struct)
    for each in msgspec.structs.fields(struct):
        lines.append(f"  {each.encode_name}{'' if each.required else '?'}: {typescript(kinds[each.name])};")
    return "\n".join([*lines, "}"])


def written() -> str:
    """Return the file's text."""
    own = [each for each in vars(protocol).values() if isinstance(each, type) and issubclass(each, msgspec.Struct)]
    structs = [each for each in own if each not in (msgspec.Struct, protocol.Message, protocol.Answer)]
    parts = [HEAD.rstrip(), *(f"export type {name} = {typescript(kind, name)};" for name, kind in ALIASES.items())]
    values = "null | boolean | number | string | number[] | string[] | number[][] | Ramp"
    parts.append(f"/** A value that can be edited, as in JSON. */\nexport type Value = {values};")
    parts.append("export type Values = Record<string, Value>;")
    parts += [interface(each) for each in structs]
    for name, union in (("PageMessage", protocol.Messages), ("ServerMessage", protocol.Answers)):
        parts.append(f"export type {name} = {' | '.join(each.__name__ for each in get_args(union))};")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    FILE.write_text(written(), encoding="utf-8")
    sys.stdout.write(f"{FILE.name} is written\n")
