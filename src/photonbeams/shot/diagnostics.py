"""Errors and warnings about scenes whose picture or beams would be black."""

from __future__ import annotations

from collections.abc import Sequence
from math import log2, pi

from .. import scene
from ..usd.common.warnings import Warnings

_NOTHING = "nothing makes beams"  # a warning that names the first such frame, and is given once
_DIM = "the suns are dim"  # likewise
_BLACK = 0.03  # an irradiance in which a surface of 18 % grey is below a level of 6 of 255


def check_content(content: scene.Scene, name: str) -> None:
    """Raise SceneError, beginning with `name`, if there is nothing to render."""
    from ..render.stage_frame import check

    try:
        check(content)
    except scene.SceneError as error:
        raise scene.SceneError(f"{name}: {error}") from None


def warn_of_darkness(content: scene.Scene, name: str, number: float, warnings: Warnings) -> None:
    """Warn once if no beams are visible: there is no fog, nothing makes beams now, or all lights are black.

    That is no error, so that a light that fades out does not end a film. Messages begin with `name`.
    """
    from ..render.stage_frame import black, makers

    names = ", ".join(black(content))
    if not content.media:
        fog = "expected a prim with PhotonBeamsMediumAPI, or a fog given by --scattering"
        warnings.give(f"{name}: there is no fog, so no beams are seen: {fog}")
    elif names:
        warnings.give(f"{name}: no beams have any light: expected some of {names} to shine")
    elif not makers(content) and not content.sky and _NOTHING not in warnings.given:
        warnings.given.add(_NOTHING)
        idle = ", ".join(light.name for light in content.lights)
        expected = f"photonbeams:enabled on {idle}" if idle else "a light that is on"
        at = f"{name}: {_NOTHING} at frame {number:.10g}"
        warnings.give(f"{at}: expected {expected}; frames without one have no beams")


def warn_of_dim_suns(content: scene.Scene, cameras: Sequence[scene.Camera], name: str, warnings: Warnings) -> None:
    """Warn if the lights that shine are all suns, in whose light, times the exposure, surfaces look black.

    Without `normalize` an intensity is the radiance of the sun's disc: 0.53 degrees have a 15,000th of it.
    """
    shining = [light for light in content.lights if max(light.radiance) > 0]
    suns = [light for light in shining if isinstance(light, scene.DistantLight)]
    if not suns or len(suns) < len(shining) or content.drawn or _DIM in warnings.given:
        return
    total = sum(sun.irradiance for sun in suns) * max(camera.exposure_scale for camera in cameras)
    if 0 < total < _BLACK:
        warnings.given.add(_DIM)  # frames with other numbers are no news
        sun = max(suns, key=lambda each: each.irradiance)
        disc = f" (a radiance of {max(sun.radiance):.3g} over {sun.angle:.3g} degrees)" if sun.angle > 0 else ""
        more = f"{log2(pi / total):.1f} stops more show them, by --exposure or inputs:exposure"
        text = f"{name}: {sun.name} gives an irradiance of {total:.2g}{disc}, in which surfaces look black"
        warnings.give(f"{text}: {more}, as does inputs:normalize, if that is off")
