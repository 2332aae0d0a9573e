"""Dress an export: write a layer with fog, portals, looks and light groups over it, as `photonbeams dress` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..runtime.files import PathLike, write_bytes
from ..scene import SceneError
from ..usd.authoring.dressing import SUFFIX, ShaftLamp, SuggestedFog, dressing
from ..usd.common.reading import file_of
from .lent import LIGHTS
from .shot import Shot
from .survey import DEPTH, Survey

_NAMED = 3  # lamps that are left as they are


def dress(shot: Shot, path: PathLike) -> list[str]:
    """Write a layer over a shot's stage and session layers, with what shafts of light need; no file of theirs changes.

    The layer has a fog that suits the distance of what the camera sees, and for each lamp of whose light in fog the
    camera sees some, a look, a light group, and a portal in each opening through which that light comes. What the stage
    already has of these stays. Comments in the layer explain each value.

    Parameters
    ----------
    shot
        A shot of a stage that is a file. What its camera sees at the stage's start counts.
    path
        The .usda file to write.

    Returns
    -------
    list of str
        Sentences about what the layer has, and what stays as it is.

    Raises
    ------
    SceneError
        Another suffix, a file that the stage is read from, nothing to see, or something that cannot be read.
    OSError
        The file cannot be written: it is written whole or not at all.

    Examples
    --------
    >>> from photonbeams.shot.dressing import dress
    >>> dress(pb.Shot.open("export.usdc"), "shot.usda")
    """
    from ..render.stage_frame import check
    from ..world.emitters.rectangles import mesh_of

    path = Path(path)
    check_path(shot, path)
    content, _ = shot.read()
    camera = shot.cameras()[0]
    try:
        check(content)
    except SceneError as error:
        raise SceneError(f"{file_of(shot.stage)}: {error}") from None
    survey = Survey(content, {camera.name: camera})
    lamps = [
        ShaftLamp(name, [mesh_of("", each).points for each in survey.openings.get(name, ())]) for name in survey.shafts
    ]
    fog = None if content.media else SuggestedFog(survey.scattering, _reason(survey))
    result = dressing(shot.stage, path.absolute(), fog, lamps, {each.group for each in content.lights})
    write_bytes(path, result.text.encode())
    others = [each.name for each in content.lights if each.name not in (*survey.shafts, *LIGHTS)]
    if others:
        more = f" and {len(others) - _NAMED:,} more" if len(others) > _NAMED else ""
        result.said.append(
            f"as they are, because the camera sees no shaft of theirs: {', '.join(others[:_NAMED])}{more}"
        )
    return result.said


def check_path(shot: Shot, path: PathLike) -> None:
    """Raise SceneError if a shot cannot be dressed by a layer at a path."""
    if Path(path).suffix != SUFFIX:
        raise SceneError(f"cannot write {path}: expected a name that ends in {SUFFIX}, whose comments can be read")
    shot.subject.check_targets([path])
    if not shot.stage.GetRootLayer().realPath:
        raise SceneError(f"cannot write {path}: expected a stage that is a file, so that a layer can name it")


def _reason(survey: Survey) -> str:
    left, camera = 100 * np.exp(-survey.scattering * survey.distance), next(iter(survey.cameras))
    return (
        f"What {camera} sees is about {survey.distance:.3g} units away. With {survey.scattering:g}, "
        f"which is {DEPTH:g} / {survey.distance:.3g} to one digit, {left:.0f} % of its light comes through: enough fog "
        "to show shafts, and still a clear view."
    )
