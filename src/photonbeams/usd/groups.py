"""The sources of beams of a shot over all times, and its light groups, so that all frames have the same layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

from ..scene import SceneError
from .common.openusd import Usd, UsdGeom
from .common.reading import PROTOTYPE_PRIMS, Reading, prims_under, target_paths, visible
from .common.warnings import Warnings
from .geometry.instancers import shown_in_prototype
from .lights.beam_settings import read_group
from .lights.curves import is_drawn
from .lights.light import is_light, is_sky, makes_beams
from .lights.links import lights_media
from .media.medium import is_medium


def groups_at_all_times(stage: Usd.Stage) -> frozenset[str]:
    """Return the groups of all lights and drawn curves on a stage that make beams at some time.

    Prims are only inspected, because reading them at all times of a film would take long. Prims are hidden or switched
    off by tokens and flags, which hold from one time sample to the next, so the sample times are enough.
    """
    at = cache(partial(Reading, stage))
    first = Reading(stage)
    media = [prim for prim in prims_under(stage.GetPseudoRoot()) if is_medium(first, prim)]
    found: set[str] = set()
    for maker in _makers(stage.GetPseudoRoot()):
        for code in maker.times():
            reading = at(code)
            group = _group_of(reading, maker.prim)
            if group not in found and maker.seen(reading) and _makes_beams(reading, maker.prim, media):
                found.add(group)
    return frozenset(found)


def _group_of(reading: Reading, prim: Usd.Prim) -> str:
    """Return the light group of a prim; none if its name cannot be that of a layer, which its reader says."""
    try:
        return read_group(reading, prim)
    except SceneError:
        return ""


def makers_at_all_times(stage: Usd.Stage) -> set[str]:
    """Return the paths of all lights and drawn curves on a stage, hidden ones too, and of the looks that they name."""
    prims = [maker.prim for maker in _makers(stage.GetPseudoRoot())]
    paths = [path for prim in prims for path in target_paths(prim, "photonbeams:look")]
    return {str(path) for path in (*paths, *(prim.GetPath() for prim in prims))}


def hidden_lights(stage: Usd.Stage, time: Usd.TimeCode) -> list[str]:
    """Return the paths of the lights on a stage that are hidden at a time."""
    lights = (maker.prim for maker in _makers(stage.GetPseudoRoot()) if maker.instancer is None)
    return [str(prim.GetPath()) for prim in lights if is_light(prim) and not visible(prim, time)]


def names_fog(stage: Usd.Stage, time: Usd.TimeCode) -> bool:
    """Return whether a stage has fog that is not hidden at a time, although it may not be readable."""
    reading = Reading(stage, time, Warnings(muted=True))
    return any(is_medium(reading, each) and visible(each, time) for each in prims_under(stage.GetPseudoRoot()))


@dataclass(frozen=True)
class _Maker:
    """A prim that may make beams, below `root`: a prototype of `instancer`, or the stage's root without one."""

    prim: Usd.Prim
    root: Usd.Prim
    instancer: _Maker | None

    def repeats(self, prim: Usd.Prim) -> bool:
        """Return whether this is `prim`, or part of one of its instances."""
        return self.prim == prim or (self.instancer is not None and self.instancer.repeats(prim))

    def seen(self, reading: Reading) -> bool:
        """Return whether the prim is rendered at a time."""
        if self.instancer is None:
            return visible(self.prim, reading.time)
        return self.instancer.seen(reading) and shown_in_prototype(reading, self.prim, self.root)

    def times(self) -> list[float | None]:
        """Return the time codes at which the prim may appear, vanish or change its group; only None if it cannot."""
        own = (self.prim.GetAttribute(f"photonbeams:{name}") for name in ("enabled", "lightGroup"))
        attributes = [*own, *self._hiding()]
        return sorted({code for each in attributes if each for code in each.GetTimeSamples()}) or [None]

    def _hiding(self) -> Iterator[Usd.Attribute]:
        yield from (each.GetAttribute("visibility") for each in self._path())
        if self.instancer is not None:
            yield from self.instancer._hiding()

    def _path(self) -> Iterator[Usd.Prim]:
        """Return the prim and those above it, up to the root."""
        prim = self.prim
        while not prim.IsPseudoRoot():
            yield prim
            if prim == self.root:
                return
            prim = prim.GetParent()


def _makers(root: Usd.Prim, instancer: _Maker | None = None) -> Iterator[_Maker]:
    """Return the lights and drawn curves at and below a prim, including those in instancers' prototypes."""
    predicate = Usd.PrimDefaultPredicate if instancer is None else PROTOTYPE_PRIMS
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(predicate)))
    for prim in walk:
        maker = _Maker(prim, root, instancer)
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()  # as in `contents`: prototypes are rendered where the instancer places them
            if instancer is not None and instancer.repeats(prim):
                continue
            for path in target_paths(prim, "prototypes"):
                if target := prim.GetStage().GetPrimAtPath(path):
                    yield from _makers(target, maker)
        elif is_light(prim) or is_drawn(prim):
            yield maker


def _makes_beams(reading: Reading, prim: Usd.Prim, media: Sequence[Usd.Prim]) -> bool:
    if is_light(prim):
        makes = makes_beams(reading, prim) or (is_sky(prim) and bool(media))
        return makes and lights_media(reading, prim, [str(each.GetPath()) for each in media])
    return bool(prim.GetAttribute("points").HasAuthoredValue())
