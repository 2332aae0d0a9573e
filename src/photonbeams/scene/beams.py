"""Drawn beams."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from .checks import Array

if TYPE_CHECKING:
    from ..looks import Look


@dataclass(frozen=True)
class DrawnBeams:
    """Beams of a scene that are given and not traced from a light, such as drawn curves.

    Attributes
    ----------
    name
        Path of the curves, or any other name.
    start, end
        (N, 3) positions of the two ends in scene units.
    radius_start, radius_end
        (N,) radii at the two ends in scene units.
    power
        (N, 3) RGB flux.
    group
        Light group, or "" (the default).
    look
        The look of the beams. Default: None, the physical look.
    offset, total
        (N,) distance along the whole curve at which each beam begins, and the length of the whole curve, in scene
        units: falloffs run over the whole curve.
    entry
        (N,) distance along the light path to the point where the medium begins, in scene units.
    end_normal
        (N, 3) normals of the surfaces that stopped the beams.
    start_tangent, end_tangent
        (N, 3) directions of the light at the two ends, by which pieces of a curve are joined.
    power_end
        (N, 3) RGB flux at the end, where the power changes along a beam.
    start_normal
        (N, 3) normals of the surfaces that the beams leave.
    side, side_normal
        (N, 3) points of surfaces beside the beams, and their normals: the beams are cut by these planes.
    random, id, generation
        (N,) inputs of looks: a random number, a number for each curve, and how often the light was scattered before.

    Notes
    -----
    Arrays that are None have the defaults of `Beams`.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0]])
    >>> drawn = pb.DrawnBeams(name="/Corner", group="lines", **pb.curved(points, 0.05, (1, 1, 1)).arrays())
    >>> len(drawn.start), drawn.total.tolist()
    (2, [2.0, 2.0])
    """

    name: str
    start: Array
    end: Array
    radius_start: Array
    radius_end: Array
    power: Array
    group: str = ""
    look: Look | None = None
    offset: Array | None = None
    total: Array | None = None
    entry: Array | None = None
    end_normal: Array | None = None
    start_tangent: Array | None = None
    end_tangent: Array | None = None
    power_end: Array | None = None
    random: Array | None = None
    id: Array | None = None
    generation: Array | None = None
    start_normal: Array | None = None
    side: Array | None = None
    side_normal: Array | None = None

    def arrays(self) -> dict[str, Array]:
        """Return all arrays that are set, keyed by the parameters of `Beams`."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        others = ("name", "group", "look")
        return {key: value for key, value in named.items() if key not in others and value is not None}
