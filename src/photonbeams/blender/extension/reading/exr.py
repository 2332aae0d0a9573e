"""Images in files of OpenEXR (openexr.com, "File Layout"): scanlines of 32-bit floats without compression."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np


def exr_of(pixels: Any) -> bytes:
    """Return the content of a file of scene-linear pixels (H, W, 3), from the top row down."""
    height, width = pixels.shape[:2]
    channels = b"".join(name + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", 20000630, 2) + b"".join(
        name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value
        for name, kind, value in (
            (b"channels", b"chlist", channels), (b"compression", b"compression", b"\0"),
            (b"dataWindow", b"box2i", window), (b"displayWindow", b"box2i", window),
            (b"lineOrder", b"lineOrder", b"\0"), (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            (b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
            (b"screenWindowWidth", b"float", struct.pack("<f", 1)),
        )
    ) + b"\0"  # fmt: skip
    row = 8 + 12 * width
    offsets = len(header) + 8 * height + row * np.arange(height, dtype="<u8")
    lines = np.empty((height, row), np.uint8)
    lines[:, :4] = np.arange(height, dtype="<i4")[:, None].view(np.uint8)
    lines[:, 4:8] = np.full((height, 1), 12 * width, "<i4").view(np.uint8)
    planes = np.asarray(pixels)[..., ::-1].transpose(0, 2, 1).astype("<f4")  # (H, 3, W): B, G, R
    lines[:, 8:] = np.ascontiguousarray(planes).reshape(height, -1).view(np.uint8)
    return header + offsets.tobytes() + lines.tobytes()
