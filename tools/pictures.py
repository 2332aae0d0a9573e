"""Digests of small pictures, to see whether a change of the code changes a bit of them.

Usage: PYTHONPATH=src python tools/pictures.py write FILE, before; PYTHONPATH=src python tools/pictures.py check FILE,
after. Digests depend on the processor and the version of LLVM, so they are not kept in the repository.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]

import photonbeams as pb  # noqa: E402
from photonbeams.runtime.device import mitsuba  # noqa: E402

Layers = dict[str, np.ndarray]


def of_file(path: Path, **options: object) -> Layers:
    """Render two passes of a shot."""
    camera = options.pop("camera", None)
    shot = pb.Shot.open(path, camera=camera)
    settings: dict[str, object] = {"passes": 2, "width": 48} | options
    return shot.render(**settings).layers


def built() -> Layers:
    """Render a scene that is built in Python."""
    lamp = pb.scene.SphereLight(
        "/Lamp", 50.0, center=(0, 2, 0), axis=(0, -1, 0), shaping=pb.scene.Shaping(cone_angle=20)
    )
    content = pb.scene.Scene(lights=lamp, media=pb.Medium(scattering=0.1))
    camera = pb.scene.Camera.look_at(origin=(6, 1, 0), target=(0, 1, 0))
    return pb.Shot(content, camera).render(passes=2, width=32).layers


def loaded() -> Layers:
    """Render a scene that Mitsuba has loaded."""
    mi = mitsuba()
    scene = mi.load_file(str(ROOT / "examples/mitsuba/slits.xml"))
    return pb.Shot(scene).render(passes=2, width=48).layers


def plugin() -> Layers:
    """Render a scene with `mi.render`."""
    mi = mitsuba()
    scene = mi.load_file(str(ROOT / "examples/mitsuba/glass_ball.xml"))
    integrator = mi.load_dict({"type": "photon_beams"})
    return {"rgb": np.array(mi.render(scene, integrator=integrator, spp=2))}


def depth(bounces: int) -> dict[str, int]:
    """Return the setting of a number of bounces."""
    return {"max_depth": bounces + 2} if bounces else {}


def rows() -> Iterator[tuple[str, Callable[[], Layers]]]:
    """Yield the rows of the matrix, as stages."""
    from tests.matrix.rows import MATRIX

    folder = Path(tempfile.mkdtemp())
    for number, row in enumerate(MATRIX):
        path = folder / f"row{number}.usda"
        path.write_text(row.stage, encoding="utf-8")
        for name, write in row.files.items():
            write(folder / name)
        yield f"row {row.name}", lambda path=path, row=row: of_file(path, width=32, **depth(row.bounces))


def cases() -> Iterator[tuple[str, Callable[[], Layers]]]:
    """Yield names and functions that render."""
    examples = ROOT / "examples"
    for name in ("keyhole", "smoke", "forest", "concert", "magic"):
        yield name, lambda path=examples / name / f"{name}.usda": of_file(path)
    yield "shaft", lambda: of_file(examples / "shaft/physical.usda")
    for name in ("cornell_fog", "mirrors", "slits", "cloud", "flask"):
        yield name, lambda path=examples / f"mitsuba/{name}.xml": of_file(path)
    yield "built", built
    yield "loaded", loaded
    yield "plugin", plugin
    yield from rows()


def main() -> int:
    """Write or check digests; return the exit code."""
    action, file = sys.argv[1], Path(sys.argv[2])
    before = json.loads(file.read_text()) if action == "check" else {}
    after: dict[str, str] = {}
    for name, render in cases():
        try:
            layers = render()
        except Exception as error:  # the others are still compared
            after[name] = f"{type(error).__name__}: {error}"
        else:
            data = b"".join(key.encode() + np.ascontiguousarray(layers[key]).tobytes() for key in sorted(layers))
            mean = float(
                np.mean(
                    [np.nan_to_num(layers[key][..., :3], posinf=0).mean() for key in ("rgba", "rgb") if key in layers]
                )
            )
            after[name] = f"{hashlib.sha256(data).hexdigest()[:16]}, mean {mean:.6g}"
        if action == "check":
            same = after[name] == before.get(name)
            print(f"{name}: {'same' if same else f'DIFFERENT: {before.get(name)} is now {after[name]}'}", flush=True)
        else:
            print(f"{name}: {after[name]}", flush=True)
    if action == "write":
        file.write_text(json.dumps(after, indent=1))
        return 0
    return int(after != before)


if __name__ == "__main__":
    raise SystemExit(main())
