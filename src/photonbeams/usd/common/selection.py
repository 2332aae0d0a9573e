"""Select what of a stage is rendered, and how finely: mask, purposes, variants and complexity, as in usdrecord.

The selection is kept in the stage's session layer, so that every reader of the stage finds it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ...scene import SceneError
from .openusd import Sdf, Usd, UsdRender

#: Levels of subdivision, by their names in usdrecord.
COMPLEXITIES = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}
_LEVEL = COMPLEXITIES["high"]  # for meshes that ask for subdivision, if no complexity is given
_SAYING = ("subdivisionScheme", "creaseIndices", "cornerIndices")  # attributes with which a mesh asks for subdivision
_PURPOSES = ("default", "render", "proxy", "guide")
_KEY = "photonbeams"  # in customLayerData of the session layer


@dataclass(frozen=True)
class Selection:
    """What of a stage is rendered.

    Attributes
    ----------
    mask
        Paths of prims: only they, what is below and above them, and what they refer to are rendered. None: everything.
    purposes
        Purposes that are rendered besides "default"; None: "render".
    variants
        Choices of variants, each "/prim{set=choice}".
    complexity
        How finely subdivision surfaces are refined: a name in COMPLEXITIES. None: "high" for meshes that ask for
        subdivision, and "low" for all others.

    Raises
    ------
    SceneError
        A value is none of these.
    """

    mask: tuple[str, ...] | None = None
    purposes: tuple[str, ...] | None = None
    variants: tuple[str, ...] = ()
    complexity: str | None = None

    def __post_init__(self) -> None:
        for path in self.mask or ():
            valid = isinstance(path, str) and path.isprintable() and Sdf.Path.IsValidPathString(path)
            if not (valid and Sdf.Path(path).IsAbsolutePath() and Sdf.Path(path).IsAbsoluteRootOrPrimPath()):
                raise SceneError(f"the mask names '{path}': expected the path of a prim, such as /World/Lamp")
        for purpose in self.purposes or ():
            if purpose not in _PURPOSES:
                raise SceneError(f"purposes name '{purpose}': expected some of {', '.join(_PURPOSES)}")
        if self.complexity is not None and self.complexity not in COMPLEXITIES:
            raise SceneError(f"complexity is '{self.complexity}': expected one of {', '.join(COMPLEXITIES)}")
        for text in self.variants:
            if _VARIANT.fullmatch(text.strip()) is None:
                raise SceneError(f"cannot select '{text}': expected /prim{{set=choice}}")

    @classmethod
    def of(
        cls,
        mask: str | Iterable[str] | None = None,
        purposes: str | Iterable[str] | None = None,
        variants: str | Iterable[str] = (),
        complexity: str | None = None,
    ) -> Selection:
        """Return the selection of a user; names in one text may be separated by commas or spaces, as in flags."""
        chosen = (variants,) if isinstance(variants, str) else tuple(variants)
        return cls(_names(mask), _names(purposes), chosen, complexity)

    def open(self, layer: Sdf.Layer, session: Sdf.Layer) -> Usd.Stage:
        """Return the stage of a layer and a session layer, and keep the selection in the latter."""
        if self.mask is None:
            stage = Usd.Stage.Open(layer, session)
        else:
            stage = Usd.Stage.OpenMasked(layer, session, Usd.StagePopulationMask(self.mask))
            stage.ExpandPopulationMask()  # adds materials, portals and so on, wherever they are
        purposes = None if self.purposes is None else " ".join(self.purposes)
        keep(session, purposes=purposes, complexity=self.complexity)
        return stage

    def apply(self, stage: Usd.Stage, name: str) -> bool:
        """Select the variants on a stage, which messages call `name`; return whether there are any.

        SceneError for missing prims.
        """
        for path in self.mask or ():
            if not stage.GetPrimAtPath(path):
                raise SceneError(f"the mask names {path}: expected a prim that is on {name}")
        for text in self.variants:
            _select(stage, text, name)
        return bool(self.variants)


EVERYTHING = Selection()


def _names(given: str | Iterable[str] | None) -> tuple[str, ...] | None:
    if given is None:
        return None
    return tuple(given.replace(",", " ").split()) if isinstance(given, str) else tuple(given)


_VARIANT = re.compile(r"(/[^{}]*)\{\s*([^={}]+?)\s*=\s*([^={}]*?)\s*\}")


def _select(stage: Usd.Stage, text: str, name: str) -> None:
    """Select one variant in the session layer."""
    matched = _VARIANT.fullmatch(text.strip())
    assert matched is not None
    path, variant_set, choice = matched.groups()
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim or prim.IsPseudoRoot():
        raise SceneError(f"cannot select '{text}': {name} has no prim {path}")
    if prim.IsInstanceProxy():
        raise SceneError(f"cannot select '{text}': {path} is inside an instance, expected a prim outside of instances")
    sets = prim.GetVariantSets()
    if variant_set not in sets.GetNames():
        found = ", ".join(sets.GetNames()) or "none"
        raise SceneError(f"cannot select '{text}': {path} has no variant set {variant_set}, expected one of {found}")
    choices = sets.GetVariantSet(variant_set).GetVariantNames()
    if choice and choice not in choices:
        raise SceneError(f"cannot select '{text}': expected {variant_set} to be one of {', '.join(choices)}")
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        chosen = sets.GetVariantSet(variant_set)
        if choice:
            chosen.SetVariantSelection(choice)
        else:
            chosen.BlockVariantSelection()


def keep(session: Sdf.Layer, **values: str | int | None) -> None:
    """Keep values in a session layer, for the readers of its stage; None leaves a value as it is."""
    given = {name: value for name, value in values.items() if value is not None}
    if given:
        session.customLayerData = {**session.customLayerData, _KEY: {**session.customLayerData.get(_KEY, {}), **given}}


def kept(stage: Usd.Stage, name: str) -> Any:
    """Return a value that is kept in a stage's session layer, or None."""
    session = stage.GetSessionLayer()
    return None if session is None else session.customLayerData.get(_KEY, {}).get(name)


def settings_at(stage: Usd.Stage, path: str | None = None) -> UsdRender.Settings | None:
    """Return the render settings at a path, without it at that in the stage's metadata; None if there are none."""
    path = str(stage.GetMetadata("renderSettingsPrimPath") or "") if path is None else path
    # OpenUSD's own function prints that a path is not one.
    valid = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsAbsoluteRootOrPrimPath()
    return (UsdRender.Settings(stage.GetPrimAtPath(path)) or None) if valid else None


def rendered_purposes(stage: Usd.Stage) -> tuple[str, ...]:
    """Return the purposes of prims that are rendered."""
    named = kept(stage, "purposes")
    return ("default", "render") if named is None else ("default", *named.split())


def refinement_level(prim: Usd.Prim, has_normals: bool) -> int:
    """Return how often a subdivision mesh is refined.

    The fallback of `subdivisionScheme` is catmullClark, but few who leave it there want their boxes rounded. Without a
    complexity, such meshes are polygons with smooth normals, as usdrecord draws them.
    """
    is_said = any(prim.GetAttribute(name).HasAuthoredValue() for name in _SAYING)
    name = kept(prim.GetStage(), "complexity")
    if has_normals and not is_said:
        return 0
    return (_LEVEL if is_said else 0) if name is None else COMPLEXITIES[name]
