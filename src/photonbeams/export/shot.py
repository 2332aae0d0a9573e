"""Export of shots as Mitsuba scenes: an .xml file, and a folder beside it with meshes and images."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from ..images.color_spaces import REC709
from ..images.frame import pixels_of
from ..runtime.device import kept_variant
from ..runtime.files import PathLike, atomic_path, write_bytes
from ..scene import SceneError, arguments
from ..shot.shot import Shot
from ..usd.common.reading import LOG, file_of, frame_number

if TYPE_CHECKING:
    from .scene import Twin


@arguments
@kept_variant()
def export(
    shot: Shot,
    path: PathLike,
    frame: float | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    crop: Sequence[float] | None = None,
) -> list[Path]:
    """Write a shot as a Mitsuba scene; warn of everything that Mitsuba cannot describe.

    Return the files that were written, the .xml first. Either all are written or none.

    Parameters
    ----------
    shot
        A shot of a stage. Everything is where it is at the frame's own time.
    path
        An .xml file. Meshes and images go to a folder beside it, which has the same name without the suffix.
    frame
        Frame number; None is the stage's start or default time.
    width, height, crop
        As for `Shot.render`.

    Raises
    ------
    SceneError
        Another suffix, a file that the stage is read from, or something on the stage that cannot be read.
    OSError
        A file cannot be written.
    """
    from ..world.cameras.cameras import Window
    from .scene import twin_of

    path = Path(path)
    check_path(shot, path)
    size = shot.resolution(width, height, frame)
    window = Window(*size, pixels_of(crop, *size))
    content, _ = shot.read(frame)
    twin = twin_of(content, shot.cameras(frame)[0], window, path.stem)
    name = file_of(shot.stage)
    number = frame_number(shot.time(frame))
    text = _xml(twin, f"{Path(name).name} at frame {number:.10g}")
    if shot.subject.spaces.working != REC709:
        twin.lost.append(
            f"its colours are numbers of {shot.subject.spaces.working}, which Mitsuba takes for linear Rec. 709: "
            "expected a shot that was opened with working_space='lin_rec709'"
        )
    for each in dict.fromkeys(twin.lost):
        LOG.warning("%s: %s", name, each)
    folder = path.parent / twin.folder
    places = {folder / name: encode for name, encode in twin.files.items()}
    shot.subject.check_targets(places, frame)
    _write(path, text, places)
    return [path, *places]


def _write(path: Path, text: str, places: Mapping[Path, Callable[[], bytes]]) -> None:
    """Write the .xml and the files beside it."""
    with ExitStack() as stack:  # none gets its name before all are whole, and the .xml gets it last
        write_bytes(stack.enter_context(atomic_path(path)), text.encode())
        for place, encode in places.items():
            write_bytes(stack.enter_context(atomic_path(place)), encode())


def check_path(shot: Shot, path: PathLike) -> None:
    """Raise SceneError if a shot cannot be exported to a path."""
    if Path(path).suffix.lower() != ".xml":
        raise SceneError(f"cannot write {path}: expected a name that ends in .xml")
    shot.subject.check_targets([path])


def _xml(twin: Twin, title: str) -> str:
    """Return a twin as the text of Mitsuba's format."""
    from ..runtime.device import mitsuba

    mi = mitsuba()
    state = mi.parser.parse_dict(mi.parser.ParserConfig(mi.variant()), {"type": "scene", **twin.parts})
    for node in state.nodes:
        if node.props.plugin_name() == "photon_beams":  # Mitsuba knows the types of its own plug-ins only
            node.type = mi.ObjectType.Integrator
    text: str = mi.parser.write_string(state, add_section_headers=True)
    # Mitsuba writes ids only where something refers to them, but users name emitters and sensors by their ids.
    text = re.sub(r'<(shape|emitter|sensor) type="([^"]*)" name="([^"]*)"', r'<\1 type="\2" id="\3"', text)
    head = f"<!-- {title.replace('--', '- -')}, by photonbeams export -->"
    return f"{head}\n{text}"
