"""Damage to files at random: bytes, pieces, and for archives of arrays their members."""

from __future__ import annotations

import random
from io import BytesIO

import numpy as np

#: What damages of text put in, beside random bytes.
WORDS = (b"nan", b"-1", b"1e39", b"inf", b"0", b"99999999999", b"\xff\xfe", b"\0", b'"', b"(", b"}", b"<", b"\n", b"@")


def damaged(data: bytes, seed: int) -> bytes:
    """Return bytes with one to four random damages."""
    draw = random.Random(seed)
    for _ in range(draw.choice((1, 1, 2, 4))):
        place, more = draw.randrange(len(data) + 1), draw.randrange(1, 40)
        kind = draw.choice(("flip", "random", "cut", "drop", "repeat", "word", "number"))
        if kind == "flip" and place < len(data):
            data = data[:place] + bytes([data[place] ^ 1 << draw.randrange(8)]) + data[place + 1 :]
        elif kind == "random":
            data = data[:place] + draw.randbytes(more) + data[place + more :]
        elif kind == "cut":
            data = data[:place]
        elif kind == "drop":
            data = data[:place] + data[place + more :]
        elif kind == "repeat":
            data = data[: place + more] + data[place:]
        elif kind == "word":
            data = data[:place] + draw.choice(WORDS) + data[place + draw.choice((0, more)) :]
        elif kind == "number":  # what may be a size
            number = draw.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000)).to_bytes(4, "little")
            data = data[:place] + number + data[place + 4 :]
    return data


def altered(arrays: dict[str, np.ndarray], seed: int) -> bytes:
    """Return an archive of these arrays with valid checksums, in which one array is another or is missing."""
    draw = random.Random(seed)
    arrays = dict(arrays)
    name = draw.choice(sorted(arrays))
    before = arrays.pop(name)
    kind = draw.choice(("gone", "renamed", "type", "shape", "more", "value", "text"))
    if kind == "renamed":
        arrays[draw.choice(("", "x", "view 0/0+2/", "view 7/0+1/x", "view 0/-1+2/x", "plate 0", name + "x"))] = before
    elif kind == "type":
        to = draw.choice(("M8[s]", "m8[D]", "S3", "U2", "f8", "i1", "?", "c8", "f2", ">f4", "V4"))
        with np.errstate(all="ignore"):
            arrays[name] = before.astype("f4").astype(to) if before.dtype.kind != "U" else np.zeros(3, to)
    elif kind == "shape":
        arrays[name] = np.resize(before, draw.choice(((), (0,), (1,), (2, 2), (3, 0), (7,), (1, 1, 5))))
    elif kind == "more":
        arrays[name], arrays["more"] = before, before
    elif kind == "value" and before.dtype.kind in "iuf":
        with np.errstate(all="ignore"):
            values = np.array(before)
            values.reshape(-1)[draw.randrange(values.size)] = np.array(
                draw.choice((-1, 0, 2**31, 2**62, np.nan, np.inf, 1e38))
            ).astype(before.dtype)
        arrays[name] = values
    elif kind == "text" and before.dtype.kind == "U":
        texts = [damaged(str(each).encode(), seed + 1).decode("latin-1") for each in before.reshape(-1)]
        arrays[name] = np.array(texts).reshape(before.shape)
    stream = BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()
