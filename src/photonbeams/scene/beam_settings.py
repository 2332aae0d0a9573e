"""Settings of the beams of a light, wherever the light itself is described."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from ..constants import MOST_BEAMS
from .checks import Count, NotNegative, SceneError, choice, count, instance, shown
from .filters import LightFilter
from .shaping import Gobo
from .surfaces import Mesh

if TYPE_CHECKING:
    from ..looks import Look

#: How beams of light that was scattered before may look.
SCATTERED = ("physical", "look", "off")


@dataclass(frozen=True, kw_only=True)
class BeamSettings:
    """Settings of the beams of a light, or of an emitter that is described elsewhere, as in a Mitsuba scene.

    Attributes
    ----------
    group
        Light group: the light's beams go to the layer `beams_<group>`. Default "", the unnamed group.
    look
        The look of the light's beams. None, the default, is the physical look.
    emits_beams
        Whether the light makes beams. Default True.
    beam_count
        Beams of the light per pass. None, the default: the renderer's number.
    beam_scale
        A factor on the power of the beams, not on the light on surfaces. Default 1.
    seed
        Seed of the beams' samples. Default 0.
    portal
        The mesh through which the light reaches the shot; it is not rendered as a surface. In a Mitsuba scene: a flat
        mesh, or the id of a flat shape with a null BSDF. Default: none.
    gobo, portal_gobo
        Images that the light shines through: one in front of the light, and one over its portal's bounding rectangle,
        or a tuple of them, each `over` an opening of the portal. Default: none.
    scattered
        What becomes of beams of the light after it was scattered: "physical" (the default), "look" (they have the look
        of beams that come straight from the light), or "off".
    filters
        Filters of its light, on surfaces, too: a `Blocker` or a `DistanceRamp` each. Default: none.
    bounces
        How often the light may be scattered before it is scattered toward the camera. None, the default: the
        renderer's number.

    Raises
    ------
    SceneError
        A factor that is negative or not finite, another word for `scattered`, a negative number of bounces or beams, a
        portal or an image of another type.

    Examples
    --------
    >>> warm = pb.Look(along=pb.looks.ColorRamp([0, 1], [[1, 0.9, 0.6], [0.8, 0.1, 0]]))
    >>> settings = pb.scene.BeamSettings(group="key", look=warm, beam_count=10_000)
    >>> settings.beam_count, settings.scattered
    (10000, 'physical')

    `pb.Shot.open("scene.xml", beams={"lamp": settings})` gives them to the emitter "lamp" of a Mitsuba scene.
    """

    group: str = ""
    look: Look | None = None
    emits_beams: bool = True
    beam_count: Annotated[int, partial(count, maximum=MOST_BEAMS)] | None = None
    beam_scale: NotNegative = 1.0
    seed: int = 0
    portal: Mesh | str | None = None
    gobo: Gobo | None = None
    portal_gobo: Gobo | tuple[Gobo, ...] | None = None
    scattered: Annotated[str, partial(choice, choices=SCATTERED)] = "physical"
    bounces: Count | None = None
    filters: tuple[LightFilter, ...] = ()

    # Not fields, without annotations: what is so for emitters that are described elsewhere.
    lights_surfaces = shines = True
    lights_media = False

    def __post_init__(self) -> None:
        if not (isinstance(self.filters, tuple) and all(isinstance(each, LightFilter) for each in self.filters)):
            raise SceneError(f"filters is {shown(self.filters)}: expected a tuple of filters")
        for each in self.portal_gobos:
            instance(each, "portal_gobo", Gobo)

    @property
    def portal_gobos(self) -> tuple[Gobo, ...]:
        """The images on the portal."""
        if self.portal_gobo is None or isinstance(self.portal_gobo, tuple):
            return self.portal_gobo or ()
        return (self.portal_gobo,)
