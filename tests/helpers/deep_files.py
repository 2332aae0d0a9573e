"""Deep EXRs of surfaces and volumes, and damaged ones."""

import struct

import OpenImageIO


def write_deep(path, samples, size, parts=1, tiled=False, views=()):
    """Write samples (Z, ZBack, A) of each pixel, returned by `samples(part, pixel)`; `views` are those of parts."""
    specs = []
    for part in range(parts):
        spec = OpenImageIO.ImageSpec(*size, 3, "float")
        spec.deep, spec.channelnames = True, ("Z", "ZBack", "A")
        spec.attribute("oiio:subimagename", f"part{part}")
        spec.attribute("compression", "zips")
        if views:
            spec.attribute("view", views[part])
        if tiled:
            spec.tile_width = spec.tile_height = 16
        specs.append(spec)
    out = OpenImageIO.ImageOutput.create(str(path))
    assert out.open(str(path), tuple(specs)) if parts > 1 else out.open(str(path), specs[0]), out.geterror()
    for part, spec in enumerate(specs):
        assert not part or out.open(str(path), spec, "AppendSubimage"), out.geterror()
        data = OpenImageIO.DeepData()
        data.init(size[0] * size[1], 3, [OpenImageIO.TypeFloat] * 3, ["Z", "ZBack", "A"])
        for pixel in range(size[0] * size[1]):
            own = samples(part, pixel)
            data.set_samples(pixel, len(own))
            for number, sample in enumerate(own):
                for channel, value in enumerate(sample):
                    data.set_deep_value(pixel, channel, number, value)
        assert out.write_deep_image(data), out.geterror()
    out.close()
    return path


def damaged(whole, packed=None, decoded=None):
    """Return a deep file's bytes with another size of the last chunk's samples, as they are stored or decoded."""
    several, tiled = struct.unpack_from("<I", whole, 4)[0] & 0x1000, b"tiledesc\0" in whole
    # The table of the chunks' places is right before the first chunk.
    tables = (_table(whole, at) for at in range(whole.rindex(b"dataWindow\0"), len(whole) - 8))
    sizes = max(next(each for each in tables if each)) + 4 * bool(several) + (16 if tiled else 4)
    result = bytearray(whole)
    for place, value in ((sizes + 8, packed), (sizes + 16, decoded)):
        if value is not None:
            struct.pack_into("<Q", result, place, value)
    return bytes(result)


def _table(whole, at):
    """Return the places of all chunks, if their table begins there."""
    (first,) = struct.unpack_from("<Q", whole, at)
    if not at < first < len(whole) or (first - at) % 8:
        return None
    places = struct.unpack_from(f"<{(first - at) // 8}Q", whole, at)
    return places if all(first <= each < len(whole) for each in places) else None
