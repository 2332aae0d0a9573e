"""Image files with random errors: they are read, or one sentence says why they cannot be read."""

import struct
import zlib

import numpy as np
from pxr import Sdf, Usd

from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST
from photonbeams.usd.common.reading import Reading
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.lights.light import read_light

SEED, CHANGES = 11, 25  # changed files of each kind; for some, the decoder's message quotes bytes that are no text


def changed(data, kind, random):
    """Return a file that is truncated, is overwritten in some places, or declares a wrong size."""
    way = random.integers(3)
    if way == 0:
        return data[: random.integers(len(data))]
    result = bytearray(data)
    if way == 1:
        for place in random.integers(0, len(data), random.integers(1, 9)):
            result[place] = random.integers(256)
        return bytes(result)
    width, height = (int(each) for each in random.choice([0, 1, 7, 2**16, 2**31 - 1, 2**32 - 1], 2))
    if kind == "png":  # with a correct checksum
        header = b"IHDR" + struct.pack(">II", width, height) + data[24:29]
        return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]
    if kind == "exr":
        place = data.index(b"dataWindow\0box2i\0") + 21
        struct.pack_into("<IIII", result, place, 0, 0, width, height)
        return bytes(result)
    if kind == "hdr":
        return data.replace(b"-Y 9 +X 14", b"-Y %d +X %d" % (height, width))
    struct.pack_into(">HH", result, data.index(b"\xff\xc0") + 5, height & 0xFFFF, width & 0xFFFF)
    return bytes(result)


def test_changed_images_are_read_or_refused_in_a_sentence(image, tmp_path):
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Sky", "DomeLight")
    random, pixels = np.random.default_rng(SEED), np.random.default_rng(SEED).random((9, 14, 3))
    refused = 0
    for kind in ("png", "exr", "hdr", "jpg"):
        data = image(f"whole.{kind}", pixels).read_bytes()
        for number in range(CHANGES):
            path = tmp_path / f"{number}.{kind}"
            path.write_bytes(changed(data, kind, random))
            prim.GetAttribute("inputs:texture:file").Set(Sdf.AssetPath(str(path)))
            reading = Reading(stage, None, Warnings(strict=True))
            try:
                light = read_light(reading, prim, np.eye(4), "/Sky")
                assert np.all(np.isfinite(light.image))
            except SceneError as error:
                refused += 1
                assert len(str(error)) <= LONGEST
                assert "inputs:texture:file names" in str(error)
    assert CHANGES < refused < 4 * CHANGES
