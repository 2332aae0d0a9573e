"""What emitters answer, those of a stage and those of a Mitsuba scene, and the light of one sample of them.

Points that scatter light take a sample of the emitters (next-event estimation), and one of a direction by their BSDF or
phase function, which may meet an emitter. The power heuristic combines both (Veach 1997).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from ...numerics.arrays import to_float
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import ONE_GROUP, LightGroups
from ...world.shadow_rays import ShadowRay
from ...world.world import World
from .toward_lamps import Balls
from .walk_vertices import ScatteredRay, Vertex

mi = mitsuba()

# The fraction of samples that is spread evenly over all emitters: a weak one may be near.
_EVENLY = 0.25


class Chosen(NamedTuple):
    """Emitters that are sampled and met.

    Attributes
    ----------
    numbers, power
        Their numbers in the world, and the power of each.
    bounces
        The most bounces of the light of each; None: the longest path alone bounds them.
    sharp, connected
        The emitters whose caustics are left to photons and beams, and those that have virtual lights.
    unmet
        The emitters that rays do not meet, so that samples of them count whole.
    grouped, coarse
        Whether their light is known by light groups, and whether transmittance is `coarse` as in `Media`.
    """

    numbers: Sequence[int]
    power: Sequence[float]
    bounces: Sequence[int] | None = None
    sharp: Collection[int] = ()
    connected: Collection[int] = ()
    unmet: Collection[int] = ()
    grouped: bool = False
    coarse: bool = True

    def groups(self, world: World) -> LightGroups:
        """Return the light groups by which their light is known."""
        return world.groups if self.grouped else ONE_GROUP


class EmitterSample(NamedTuple):
    """A sample of the emitters from vertices.

    Attributes
    ----------
    lit, connected
        Whether there is light, and whether its emitter has virtual lights.
    direction, distance, over
        Where the light comes from, its distance, and the distance over which media dim it.
    radiance, pdf
        The radiance over the density, and the density against which rays that meet the emitter are weighted; 0: none
        can.
    group
        The number of its light group.
    """

    lit: Bool
    connected: Bool
    direction: Array3f
    distance: Float
    over: Float
    radiance: Array3f
    pdf: Float
    group: UInt32


class EmitterChoice:
    """The choice of one of some emitters of these powers, with the `probabilities` (N,)."""

    def __init__(self, power: Sequence[float]) -> None:
        part = np.asarray(power) / sum(power) if sum(power) > 0 else np.zeros(len(power))
        part = _EVENLY / len(power) + (1 - _EVENLY) * part
        self.probabilities = part / part.sum()
        self._distribution = mi.DiscreteDistribution(mi.Float(to_float([*self.probabilities, 0.0])))

    def __call__(self, which: Float) -> tuple[UInt32, Float]:
        """Return the emitter that a number in [0, 1) chooses, and what is left of that number, in [0, 1) again."""
        number, rest = self._distribution.sample_reuse(mi.Float(which))
        return UInt32(number), Float(rest)

    def probability(self, number: UInt32, active: Bool) -> Float:
        """Return the probabilities of emitters."""
        return Float(self._distribution.eval_pmf_normalized(number, active))


class Emitters(Protocol):
    """The emitters that light vertices, of which one is chosen for each sample."""

    world: World
    groups: LightGroups
    choice: EmitterChoice

    @property
    def balls(self) -> Balls | None:
        """The spheres around the emitters, by their numbers; None: no medium scatters light."""

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen emitters from active vertices, as if nothing were between."""

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces, and these.

        `medium` is that in which the camera path arrives at the hits.
        """

    def met(
        self, ray: ScatteredRay, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of these emitters where rays meet them, weighted against that of `sampled`.

        Parameters
        ----------
        ray, hit
            The rays, and the surfaces ahead of them.
        weight, arrives
            The weights of their free flights, and which flights end at these surfaces.
        active, seed
            The rays whose light counts, and seeds for the transmittance of media.
        kept
            Factors on the light of emitters that have virtual lights; None: no emitter has any.
        """


def arriving(
    passed: Callable[[Vertex, EmitterSample, UInt32, Bool], Array3f], vertex: Vertex, light: EmitterSample,
    value: Array3f, pdf: Float, seed: UInt32,
) -> Array3f:  # fmt: skip
    """Return the light of samples of emitters that vertices scatter toward the camera, value · L / p_L · T · w.

    `passed` is that of the emitters: it returns T. The BSDF times cosine, or the phase function, has that `value`
    there, and its samples the density `pdf` = p, so that w = p_L² / (p_L² + p²).
    """
    value = value * light.radiance * dr.select(light.pdf > 0, power_heuristic(light.pdf, pdf), 1)
    useful = light.lit & (dr.max(value) > 0) & dr.isfinite(dr.sum(value))
    return dr.select(useful, value * passed(vertex, light, seed, useful), 0)
