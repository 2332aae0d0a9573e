"""Messages through a pipe: the length of a text, the text in JSON, and the bytes of the arrays in it.

Both ends use this module: Blender's Python and the renderer's. An array is {"array": [type, shape]} in the text, and
where it occurs again {"array": its number}; the bytes of all arrays follow in the order of the text.
"""

from __future__ import annotations

import json
import struct
from typing import IO, Any

import numpy as np

_LENGTH = struct.Struct("<Q")


def write(pipe: IO[bytes], message: dict[str, Any]) -> None:
    """Write a message; its values may be arrays."""
    arrays: list[np.ndarray] = []
    numbers: dict[int, int] = {}  # by identity: instances of an object share its arrays

    def described(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if id(value) in numbers:
            return {"array": numbers[id(value)]}
        numbers[id(value)] = len(arrays)
        arrays.append(value)
        return {"array": [value.dtype.str, value.shape]}

    text = json.dumps(message, default=described).encode()
    pipe.write(_LENGTH.pack(len(text)) + text)
    for each in arrays:
        pipe.write(np.ascontiguousarray(each).reshape(-1).view(np.uint8).data)
    pipe.flush()


def read(pipe: IO[bytes]) -> dict[str, Any] | None:
    """Return the next message; None if the other end has closed the pipe."""
    arrays: list[np.ndarray] = []

    def rebuilt(found: dict[str, Any]) -> Any:
        if found.keys() != {"array"}:
            return found
        if isinstance(found["array"], int):
            return arrays[found["array"]]
        kind, shape = found["array"]
        data = bytearray(np.dtype(kind).itemsize * int(np.prod(shape)))
        _fill(pipe, memoryview(data))
        arrays.append(np.frombuffer(data, kind).reshape(shape))
        return arrays[-1]

    try:
        head = bytearray(_LENGTH.size)
        _fill(pipe, memoryview(head))
        text = bytearray(_LENGTH.unpack(head)[0])
        _fill(pipe, memoryview(text))
        # Objects are rebuilt in the order of the text, so the bytes are read in that order, too.
        message: dict[str, Any] = json.loads(text, object_hook=rebuilt)
    except (EOFError, OSError, ValueError):  # a closed file is a ValueError
        return None
    return message


def _fill(pipe: IO[bytes], into: memoryview) -> None:
    """Read bytes until `into` is full; raise EOFError if there are no more."""
    while into:
        count = pipe.readinto(into)  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        into = into[count:]
