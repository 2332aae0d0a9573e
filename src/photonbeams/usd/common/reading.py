"""Read a stage at one time: values, transforms, and messages that name file, prim and attribute."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any, TypeAlias, TypeVar, Union

import numpy as np
import numpy.typing as npt

from ...scene import FARTHEST, Array, Color, Mesh, SceneError, color, number
from ...scene.checks import shown
from .color_spaces import RAW, color_space, source_space, spaces_of, to_working
from .openusd import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdUtils
from .selection import rendered_purposes
from .warnings import LOG, MissingError, Warnings

T = TypeVar("T")

#: A time of a stage: a time code, a number, or None for the default time.
Time: TypeAlias = Union["Usd.TimeCode", float, None]
#: What the names of a light's inputs begin with, since OpenUSD 21.02.
INPUTS = "inputs:"
#: What readings share, by key.
Cache: TypeAlias = dict[tuple[object, ...], Any]


@contextmanager
def quiet() -> Iterator[None]:
    """Turn what OpenUSD would print on standard error into debug messages, which -v shows."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        found = delegate.TakeUncoalescedDiagnostics()
        del delegate  # ends the redirection
        for each in found:
            with suppress(UnicodeDecodeError):  # it may quote a broken file
                LOG.debug("%s", each.commentary)


def file_of(stage: Usd.Stage) -> str:
    """Return the name of a stage's root layer, for messages."""
    layer = stage.GetRootLayer()
    return "the stage" if layer.anonymous else str(layer.realPath or layer.identifier)


def frame_number(time: Usd.TimeCode) -> float:
    """Return the frame number of a time code, as used in file names: 0 at the default time."""
    return 0.0 if time.IsDefault() else float(time.GetValue())


@dataclass
class Reading:
    """A stage at a time, the warnings given so far, and caches of what was read.

    Attributes
    ----------
    stage, time
        The stage, and a time code or its number; None is the default time, at which attributes that have only time
        samples return the first.
    warnings
        The warnings given so far; the frames of a shot share them, so that each is given once.
    cache
        Decoded textures, materials that may vary, and triangulated prototypes by key.
    base
        The frame from whose time samples velocities move points while the shutter is open; None: `time`.
    lasting
        What was read and is the same at all times, by key; readings of a stage share it until the stage changes.
    surfaces
        The meshes of prims read at this time, with their transforms, by name.
    triangles, expected
        How many triangles have been read, counting every copy, and an estimate of how many are still to come.
    """

    stage: Usd.Stage
    time: Any = None
    warnings: Warnings = field(default_factory=Warnings)
    cache: Cache = field(default_factory=dict)
    base: Any = None
    lasting: Cache = field(default_factory=dict)
    surfaces: dict[str, tuple[Array, list[Mesh]]] = field(default_factory=dict)
    triangles: int = 0
    expected: int = 0

    def __post_init__(self) -> None:
        self.time = _time_code(self.time)
        self.base = self.time if self.base is None else _time_code(self.base)
        self.xforms = UsdGeom.XformCache(self.time)
        self.spaces = spaces_of(self.stage)

    def place(self, prim: Usd.Prim, name: str = "") -> str:
        """Return "file: /prim.attribute", the beginning of messages."""
        return f"{file_of(self.stage)}: {_path(prim, name)}"

    def fail(self, prim: Usd.Prim, name: str, text: str) -> SceneError:
        """Return, for raising, an error about an attribute; `text` is such as "is 0: expected ..."."""
        return SceneError(f"{self.place(prim, name)} {text}")

    def missing(self, prim: Usd.Prim, name: str, text: str) -> MissingError:
        """Return, for raising, the error that something is missing which an attribute names; `text` as for `fail`."""
        return MissingError(f"{self.place(prim, name)} {text}", self._frame_of(prim.GetAttribute(name)))

    def lack(self, prim: Usd.Prim, text: str, name: str = "") -> None:
        """Warn once a frame that something is missing which an attribute names."""
        frame = self._frame_of(prim.GetAttribute(name))
        self.warnings.lack(f"{_path(prim, name)} {text}", file_of(self.stage), frame=frame)

    def _frame_of(self, attribute: Usd.Attribute) -> float | None:
        """Return the frame that is read, if an attribute may have another value at others; else None."""
        return self.frame if attribute and may_vary(attribute) else None

    @property
    def frame(self) -> float | None:
        """The number of the frame that is read, or None if there is only one."""
        return None if self.base.IsEarliestTime() else frame_number(self.base)

    def warn(self, prim: Usd.Prim, text: str, name: str = "") -> None:
        """Warn once about something that cannot be rendered; SceneError if warnings are errors."""
        self.warnings.give(f"{_path(prim, name)} {text}", file_of(self.stage))

    def attempt(self, prim: Usd.Prim, read: Callable[[], T], otherwise: T, instead: str) -> T:
        """Return what `read` returns, or `otherwise`, with a warning, if that part of the stage cannot be used.

        Parameters
        ----------
        prim
            The prim that is read.
        instead
            What is done without that part, as the end of the warning: "it is skipped".

        Raises
        ------
        SceneError
            `read` raises it, and warnings are errors.
        """
        file = file_of(self.stage)
        try:
            return read()
        except SceneError as error:
            missing = error if isinstance(error, MissingError) else None
            if self.warnings.strict is True or (missing and self.warnings.strict):
                raise
            text = error.whole
            text = text.removeprefix(f"{file}: ") if text.startswith(f"{file}: /") else f"{prim.GetPath()}: {text}"
            if missing:
                self.warnings.lack(text, file, instead, missing.frame)
                return otherwise
        except Exception:  # unforeseen types or sizes of values: errors from OpenUSD and NumPy
            LOG.debug("%s", self.place(prim), exc_info=True)
            text = f"{prim.GetPath()} cannot be read"
        self.warnings.give(text, file, instead)
        return otherwise

    def varies(self, prim: Usd.Prim) -> bool:
        """Return whether an attribute of a prim may change with time, or velocities move its points."""
        key = ("varies", prim.GetPath())
        if key not in self.lasting:
            moving = prim.GetAttribute("velocities").HasAuthoredValue()
            self.lasting[key] = moving or any(may_vary(each) for each in prim.GetAuthoredAttributes())
        return bool(self.lasting[key])

    def warn_of_unknown(self, prim: Usd.Prim, name: str, known: Collection[str]) -> None:
        """Warn about an attribute that prims of this kind do not have, and suggest a similar name."""
        short = {each.removeprefix("photonbeams:"): each for each in known}
        near = get_close_matches(name.removeprefix("photonbeams:"), short, 1, 0.7)
        meant = "".join(f"; expected {short[each]}" for each in near)
        kind = prim.GetTypeName() or "prim without a type"
        self.warn(prim, f"is not an attribute of a {kind}: it is ignored{meant}", name)

    def attribute(self, prim: Usd.Prim, name: str) -> Usd.Attribute:
        """Return an attribute, or what a light has instead: its name from before OpenUSD 21.02, without "inputs:"."""
        found, short = prim.GetAttribute(name), name.removeprefix(INPUTS)
        if short == name or (found and found.HasAuthoredValue()):
            return found
        old = prim.GetAttribute(short)
        known = found or short.startswith(("shaping:", "shadow:"))  # their schemas need not be applied
        return old if old and known and old.HasAuthoredValue() and prim.HasAPI(UsdLux.LightAPI) else found

    def value(self, prim: Usd.Prim, name: str, default: object = None) -> Any:
        """Return an attribute's value or fallback at the time, or `default` if it has none."""
        attribute = self.attribute(prim, name)
        result = attribute.Get(self.time) if attribute else None
        if isinstance(result, str) and not name.startswith("photonbeams:"):
            result = self._token(prim, attribute, result)
        return default if result is None else result

    def _token(self, prim: Usd.Prim, attribute: Usd.Attribute, value: str) -> str | None:
        """Return a value, or the fallback, with a warning, if the schema does not allow this token."""
        allowed = attribute.GetMetadata("allowedTokens")
        if not allowed or value in allowed:
            return value
        fallback = prim.GetPrimDefinition().GetAttributeFallbackValue(attribute.GetName())
        used = "it is ignored" if fallback is None else f"{fallback} is used"
        self.warn(prim, f"is '{value}': expected one of {', '.join(allowed)}; {used}", attribute.GetName())
        return None if fallback is None else str(fallback)

    def number(
        self, prim: Usd.Prim, name: str, default: float, minimum: float = -np.inf, maximum: float = np.inf
    ) -> float:
        """Return a number, checked to be finite and within its bounds."""
        value = self.value(prim, name, default)
        if not isinstance(value, (int, float)):
            raise self.fail(prim, name, f"is {shown(value)}: expected a number")
        return number(value, self.place(prim, name), minimum, maximum)

    def positive(self, prim: Usd.Prim, name: str, default: float) -> float:
        """Return a number above 0."""
        value = self.number(prim, name, default, minimum=0.0)
        if value == 0:
            raise self.fail(prim, name, "is 0: expected a positive number")
        return value

    def clipped(self, prim: Usd.Prim, name: str, default: float, minimum: float, maximum: float = np.inf) -> float:
        """Return a finite number; for one out of its bounds the nearest, with a warning."""
        value = self.number(prim, name, default)
        nearest = min(max(value, minimum), maximum)
        if np.float32(nearest) != np.float32(value):
            expected = f"{minimum:g} or more" if maximum == np.inf else f"{minimum:g} to {maximum:g}"
            self.warn(prim, f"is {value:g}: expected {expected}; {nearest:g} is used", name)
        return nearest

    def color(self, prim: Usd.Prim, name: str, default: object) -> Color:
        """Return a colour in the working space, checked to be finite and not negative."""
        value = self.value(prim, name, default)
        try:
            numbers = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if numbers.shape not in ((), (3,)):
            raise self.fail(prim, name, f"is {shown(value)}: expected a colour")
        attribute = self.attribute(prim, name)
        return color(self._positive(attribute, numbers) if attribute else numbers, self.place(prim, name))

    def in_working_space(self, attribute: Usd.Attribute, values: Array) -> Array:
        """Return an attribute's numbers (C,) or (N, C), their colours converted to the working space.

        Colours are numbers whose attribute names a colour space, or whose type is that of colours.
        """
        is_color = attribute.HasColorSpace() or attribute.GetRoleName() == "Color"
        if not is_color or not values.ndim or values.shape[-1] < 3:
            return values
        name = source_space(attribute)
        space = color_space(name)
        if space is None:
            text = f"has the colour space '{name}', which neither OpenUSD nor OpenColorIO knows: it is linear Rec. 709"
            self.warn(attribute.GetPrim(), text, attribute.GetName())
        colors = values[..., :3]
        result = to_working(colors, space or RAW, self.spaces)
        return values if result is colors else np.concatenate([result, values[..., 3:]], axis=-1)

    def _positive(self, attribute: Usd.Attribute, values: Array) -> Array:
        """Return colours in the working space; those that were not negative in their own are not there either."""
        result = self.in_working_space(attribute, values)
        if result is values or np.any(values < 0):
            return result
        if np.any(result < -1e-5):
            worst = np.atleast_2d(result)[int(np.argmin(np.atleast_2d(result).min(axis=1)))]
            numbers = ", ".join(f"{each:.3g}" for each in worst)
            text = f"is ({numbers}) in {self.spaces.working}: numbers below 0 count as 0"
            self.warn(attribute.GetPrim(), text, attribute.GetName())
        return np.maximum(result, 0)

    def flag(self, prim: Usd.Prim, name: str, default: bool) -> bool:
        """Return an attribute's value as a bool."""
        return bool(self.value(prim, name, default))

    def choice(self, prim: Usd.Prim, name: str, default: str | None, choices: Collection[str]) -> str:
        """Return a text, checked to be one of the choices."""
        value = str(self.value(prim, name, default))
        if value not in choices:
            raise self.fail(prim, name, f"is '{value}': expected one of {', '.join(choices)}")
        return value

    def array(self, prim: Usd.Prim, name: str, columns: int, value: Any = None) -> Array | None:
        """Return an array attribute (or its given `value`) as (N, columns) finite float64, or None if it is empty."""
        raw = self.value(prim, name) if value is None else value
        if raw is not None and (isinstance(raw, str) or not hasattr(raw, "__len__")):
            raise self.fail(prim, name, f"is {shown(raw)}: expected a list of values")
        if raw is None or len(raw) == 0:
            return None
        try:
            numbers = np.asarray(raw, dtype=np.float64).reshape(len(raw), columns)
        except (TypeError, ValueError):
            raise self.fail(prim, name, f"has values of another type: expected {columns} numbers each") from None
        finite = np.isfinite(numbers).all(axis=1)
        if not finite.all():
            index = int(np.argmin(finite))
            raise self.fail(prim, f"{name}[{index}]", f"is {raw[index]}: expected finite numbers")
        attribute = prim.GetAttribute(name)
        return self._positive(attribute, numbers) if attribute else numbers

    def vector(self, prim: Usd.Prim, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return as many numbers as `default` has; they need not be finite."""
        value = self.value(prim, name, default)
        try:
            return tuple(float(each) for each, _ in zip(value, default, strict=True))
        except (TypeError, ValueError):
            raise self.fail(prim, name, f"is {shown(value)}: expected {len(default)} numbers") from None

    def integers(self, prim: Usd.Prim, name: str) -> Array:
        """Return an array of whole numbers, (N,), empty if there is none."""
        raw = self.value(prim, name, ())
        found = np.asarray(raw) if not isinstance(raw, str) and hasattr(raw, "__len__") else np.asarray(None)
        if len(np.shape(found)) != 1 or (len(found) and found.dtype.kind not in "iu"):
            raise self.fail(prim, name, f"is {shown(raw)}: expected a list of whole numbers")
        return found.astype(np.int64)

    def to_world(self, prim: Usd.Prim) -> Array:
        """Return a prim's (4, 4) transform to world space, for column vectors."""
        try:
            return self.matrix(prim, self.xforms.GetLocalToWorldTransform(prim))
        except Tf.ErrorException:  # from the prim or an ancestor
            raise self.fail(prim, "xformOpOrder", "has an entry that is not a transform: expected xformOps") from None

    def matrix(self, prim: Usd.Prim, matrix: Gf.Matrix4d) -> Array:
        """Return USD's row-vector matrix as a finite (4, 4) for column vectors."""
        result = np.array(matrix, dtype=np.float64).T
        if not np.all(np.isfinite(result)):
            raise self.fail(prim, "", "has a transform that is not finite: expected finite numbers")
        self.within_reach(prim, result)
        return result

    def within_reach(self, prim: Usd.Prim, values: npt.ArrayLike) -> None:
        """Raise SceneError if a prim's lengths or coordinates in world space are too large to be rendered."""
        farthest = float(np.max(np.abs(values), initial=0.0))
        if not farthest <= FARTHEST:
            text = f"reaches {farthest:g} units from the origin: expected no more than {FARTHEST:g}"
            raise self.fail(prim, "", text)

    def targets(self, prim: Usd.Prim, name: str) -> list[Usd.Prim]:
        """Return the prims that a relationship names; SceneError names one that is missing."""
        if prim.GetAttribute(name) or not is_relationship(prim, name):
            raise self.fail(prim, name, "is an attribute: expected a relationship, rel")
        paths = target_paths(prim, name)
        found = [self.stage.GetPrimAtPath(path) for path in paths]
        for path, target in zip(paths, found, strict=True):
            if not target or not target.IsActive():
                raise self.missing(prim, name, f"names {path}: expected a prim that is on the stage")
        return found


def _path(prim: Usd.Prim, name: str) -> str:
    return f"{prim.GetPath()}{'.' if name else ''}{name}"


def _time_code(time: Any) -> Usd.TimeCode:
    if not isinstance(time, Usd.TimeCode):
        time = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    return Usd.TimeCode.EarliestTime() if time.IsDefault() else time


def target_paths(prim: Usd.Prim, name: str) -> list[Sdf.Path]:
    """Return the paths that a relationship names, whether the prims exist or not; none if it is an attribute."""
    relationship = prim.GetRelationship(name)
    return list(relationship.GetForwardedTargets()) if relationship and is_relationship(prim, name) else []


def is_relationship(prim: Usd.Prim, name: str) -> bool:
    """Return whether no layer authors a relationship as an attribute, which the prim's schema does not show."""
    return all(isinstance(spec, Sdf.RelationshipSpec) for spec in prim.GetRelationship(name).GetPropertyStack())


def visible(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    """Return whether a prim is rendered: it is not invisible, and has a purpose that is rendered."""
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return True
    purpose = imageable.ComputePurpose()
    return imageable.ComputeVisibility(time) != "invisible" and purpose in rendered_purposes(prim.GetStage())


def has_photonbeams(prim: Usd.Prim, schema: str, *attributes: str) -> bool:
    """Return whether an API schema is applied, or one of these attributes is authored without it."""
    if schema in prim.GetAppliedSchemas():
        return True
    return any(prim.GetAttribute(f"photonbeams:{name}").HasAuthoredValue() for name in attributes)


def varying_attributes(stage: Usd.Stage) -> Iterator[Usd.Attribute]:
    """Return the attributes on a stage that may change with time."""
    for prim in prims_under(stage.GetPseudoRoot()):
        yield from (each for each in prim.GetAuthoredAttributes() if may_vary(each))


def may_vary(attribute: Usd.Attribute) -> bool:
    """Return whether an attribute may change with time."""
    try:
        return bool(attribute.ValueMightBeTimeVarying())
    except Tf.ErrorException:  # its only time sample is at NaN
        return False


#: Prims of prototypes, which may be `over` or `class`.
PROTOTYPE_PRIMS = Usd.PrimIsActive & Usd.PrimIsLoaded


def prims_under(root: Usd.Prim) -> Iterator[Usd.Prim]:
    """Return the prims at and below `root`, including those inside instances."""
    yield from Usd.PrimRange(root, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
