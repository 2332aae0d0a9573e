"""Messages of all sorts: each is executed, refused or ends its connection, and the studio goes on."""

import json

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from photonbeams.studio import protocol
from tests.helpers.sweep import sweep
from tests.studio.serving import Served
from tests.studio.sessions import INTENSITY, STAGE, TINT

KINDS = ("set", "apply", "undo", "redo", "revert", "discard", "show", "inspect", "render",
         "estimate", "cancel", "sett", 3, None)  # fmt: skip
FIELDS = ("values", "step", "size", "camera", "pose", "frame", "area", "lens", "blur", "solo", "paused", "layer",
          "exposure", "display", "at", "passes", "frames", "preset", "path", "stereo", "eye", "denoise",
          "number", "more")  # fmt: skip
PATHS = (INTENSITY, TINT, "/World/Look.photonbeams:along:expression", "/World/Look.photonbeams:along:ramp:knots",
         "/World/Lamp.photonbeams:look", "/World/Lamp.photonbeams:lightGroup", "/World/Fog.photonbeams:scattering",
         "/World/Lamp.visibility", "/World/Gone.a", "/World", "", "../x", "/World/Ball.radius")  # fmt: skip
PRESETS = ("look-fading", "along-even", "look-gone")
VALUES = (0, 1, -1, 2.5, 1e300, -0.0, True, False, None, "", "x", "1 + (", "invisible", "/World/Look", [], [1, 2, 3],
          [0.1, 0.2, 0.3], [[1, 2, 3]], ["/World/Look"], {"a": 1}, [1e40] * 3, "é" * 40, [0.0, 0.5, 1.0], [24, 13],
          )  # fmt: skip


def message(rng):
    """Return a random message; most are nearly valid."""
    if rng.random() < 0.03:
        return bytes(rng.integers(0, 256, 20).tolist()) if rng.random() < 0.5 else "x" * int(rng.integers(1, 200))
    found = {"type": KINDS[rng.integers(len(KINDS))] if rng.random() < 0.7 else "set"}
    if found["type"] == "set":
        count = int(rng.integers(1, 4))
        found["values"] = {PATHS[rng.integers(len(PATHS))]: VALUES[rng.integers(len(VALUES))] for _ in range(count)}
    if found["type"] == "apply":
        paths = ("/World/Lamp", "/World/Look", "/World/Gone")
        found |= {"preset": PRESETS[rng.integers(len(PRESETS))], "path": paths[rng.integers(len(paths))]}
    for _ in range(int(rng.integers(0, 3)) if rng.random() < 0.5 else 0):
        found[FIELDS[rng.integers(len(FIELDS))]] = VALUES[rng.integers(len(VALUES))]
    return json.dumps(found)


@pytest.mark.parametrize("count", sweep([500, 5000], [500]))
def test_the_studio_outlives_thousands_of_messages(count, tmp_path, monkeypatch):
    monkeypatch.setattr(protocol, "PER_SECOND", 10 * count)
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    served, rng, sent = Served(path), np.random.default_rng(5), 0
    try:
        with served.page() as page:
            _, plain = page.finished()
        while sent < count:
            with served.page() as page:
                try:
                    while sent < count:
                        page.send_raw(message(rng))
                        sent += 1
                        if sent % 50 == 0:  # unread answers would fill its buffers
                            page.send("inspect", at=[0.5, 0.5])
                            page.told("pixel")
                except ConnectionClosed:
                    pass
        with served.page() as page:
            page.send("revert")
            page.send("show", size=[48, 27], camera=None, pose=None, frame=None, area=None, lens=True, blur=True,
                      solo=[], paused=False, layer="rgba", exposure=0.0, display="photonbeams", stereo=None, eye="left",
                      denoise=False)  # fmt: skip
            page.send("inspect", at=[0.5, 0.5])
            page.told("pixel")
            _, after = page.finished(served.session.version)
        np.testing.assert_array_equal(after, plain)
    finally:
        served.close()
