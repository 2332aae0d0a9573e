"""Render the gallery of docs/mitsuba.md: scenes of examples/mitsuba by `photon_beams` and by `volpath` in equal time.

`make pictures` calls it; with names it renders those alone. Seconds, passes and samples are written into
the page, under the pictures.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from pages import DOCS, ROOT

PAGE = DOCS / "mitsuba.md"
NOISY = 75  # quality of pictures that are mostly noise, which takes many bytes

#: Scenes of examples/mitsuba: width and height of their pictures, seconds for each, and the exposure in stops.
SCENES = {
    "glass_ball": (1280, 720, 150.0, 1.0),
    "slits": (1280, 720, 150.0, 0.0),
    "mirrors": (1280, 720, 180.0, 0.5),
    "flask": (1280, 720, 150.0, 0.5),
    "cloud": (1280, 720, 60.0, 0.0),
    "cornell_fog": (960, 960, 60.0, 0.0),
}


def main() -> None:
    """Write the pictures, and what they took."""
    page = PAGE.read_text()
    for name in sys.argv[1:] if __name__ == "__main__" and len(sys.argv) > 1 else SCENES:
        page = noted(page, name, *pair(name))
        PAGE.write_text(page)  # after each: an hour is long


def pair(name: str) -> tuple[float, int, float, int]:
    """Write two pictures of a scene; return seconds and passes of ours, seconds and samples of Mitsuba's."""
    import photonbeams as pb
    from photonbeams.runtime.device import mitsuba

    mi = mitsuba()
    width, height, limit, exposure = SCENES[name]
    path = ROOT / "examples" / "mitsuba" / f"{name}.xml"
    shot = pb.Shot.open(path)
    given = {"width": width, "height": height, "denoise": True}
    shot.render(passes=1, **given)  # compiles
    seconds, frame = timed(lambda: shot.render(passes=1 << 14, time_limit=limit, **given))
    write(f"{name}-beams", frame.layers["rgba"][..., :3], exposure)

    scene = mi.load_file(str(path))
    parameters = mi.traverse(scene)
    parameters[next(each for each in parameters.properties if each.endswith("film.size"))] = [width, height]
    parameters.update()
    integrator = mi.load_dict({"type": "volpath", "rr_depth": 50})

    def volpath(samples: int, seed: int) -> Any:
        return np.array(mi.render(scene, integrator=integrator, spp=samples, seed=seed))[..., :3]

    volpath(4, 0)
    total, count, begin = 0.0, 0, perf_counter()
    while perf_counter() - begin < seconds:
        total, count = total + volpath(4, count), count + 1
    write(f"{name}-volpath", total / count, exposure)
    return seconds, frame.statistics.passes, perf_counter() - begin, 4 * count


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Return the seconds that a call takes, and its result."""
    begin = perf_counter()
    result = run()
    return perf_counter() - begin, result


def write(name: str, pixels: Any, exposure: float) -> None:
    """Write a picture."""
    from renders import QUALITY, keep

    from photonbeams.images.display import srgb_encoded, tone_mapped

    levels = 255 * srgb_encoded(tone_mapped(np.nan_to_num(pixels) * 2.0**exposure))
    keep(levels, name, NOISY if name.endswith("-volpath") else QUALITY)


def noted(page: str, name: str, seconds: float, passes: int, others: float, samples: int) -> str:
    """Return the page with what a pair of pictures took, under the pair."""
    took = f"{passes} passes in {seconds:.0f} s; {samples} samples in {others:.0f} s"
    line = re.compile(rf"(\(pictures/{name}-volpath\.webp\) \|\n\n)\*[^*\n]*\*")
    if not line.search(page):
        raise ValueError(f"{PAGE}: has no line for what the pictures of {name} took")
    return line.sub(rf"\g<1>*{took}.*", page)


if __name__ == "__main__":
    main()
