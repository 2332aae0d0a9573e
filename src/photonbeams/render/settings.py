"""How a frame is rendered: one record for stages and Mitsuba scenes, made from the arguments and passed on whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from numbers import Real
from typing import Any, TypedDict

import numpy as np

from ..beams.programs import Program
from ..estimators.estimate import DEFAULT_RULE, check_estimator
from ..quadrature import Rule
from ..scene import MOST_BEAMS, SceneError, real, whole
from ..scene.cameras import FILTERS
from .passes import OVERLAP

#: Light paths in a pass of a Mitsuba scene. On a stage each light has `scene.DEFAULT_BEAMS`.
DEFAULT_PATHS = 1 << 14

# Passes where the user gives no number. With a goal for the error, nearly all frames end before the second number.
_PASSES, _MOST_FOR_ERROR = 16, 4096

METHODS = ("auto", "beams", "paths")

_MOST = 2**31 - 1

_FLAGS = ("normals", "albedo", "denoise", "keep_noisy")


def usual_passes(error: float | None) -> int:
    """Return the default number of passes, with a goal for the `error` or without (None)."""
    return _PASSES if error is None else _MOST_FOR_ERROR


@dataclass(frozen=True)
class Settings:
    """How a frame is rendered. Where None is allowed, it leaves the choice to the scene, or to its kind.

    Attributes
    ----------
    passes, time_limit, error
        Number of passes, seconds after which no further pass is begun, and the relative error (see `Statistics`) at
        which there are enough passes; the latter two may be None. The default of `passes` is 16; with an error, it is
        an upper bound, and its default is 4096.
    seed
        Seed of all samples.
    beams
        Light paths in a pass. None: 4096 for each light of a stage that does not set its own number, 16384 for a
        Mitsuba scene.
    max_depth
        The longest path in edges, as Mitsuba counts: 2 is light that was scattered once, −1 is any length. None: that
        of the scene, which is 2 for a stage and any length for a Mitsuba scene.
    rr_depth, hide_emitters
        As in Mitsuba's `volpath`: the bounces after which Russian roulette begins, and whether emitters are hidden
        from the camera.
    radius
        Radius of all beams in the first pass, in scene units. None: from photon differentials, between `min_radius`
        and `max_radius`. If these are None, they are 1e-4 and 0.05 of the medium's radius, and radii are at most a
        quarter of a mean free path (in a grid, of the mean free path at the beam).
    overlap
        Width of beams, in distances between neighbours.
    alpha
        How fast radii shrink from pass to pass; with 1 they do not.
    guiding
        Whether a pilot pass learns where the light that the camera sees comes from, to send more light paths from
        there. None: yes. On a stage it learns for the cameras of all frames.
    method
        For a Mitsuba scene, how the light of emitters without settings of their own is found: "beams", "paths" from the
        camera (see `walks`), or "auto", whichever has less noise (see `choice`).
    short
        Whether beams end where their light is scattered, instead of at the next surface.
    estimator, rule
        "auto", "billboard" or "frustum", and the frustum's quadrature.
    gather_error
        Approximate relative error that may come from gathering beams along fewer rays than there are pixels (see
        `estimators.coarse`). 0: all beams are gathered through every pixel.
    surfaces
        Whether surfaces are shaded; if not, only beams are rendered.
    surface_samples
        How many samples each pixel has in a pass of everything but beams, which costs less: a power of two. None: as
        many as cost half of what the beams cost, up to 16 (see `costs`).
    normals, albedo
        Whether there is a layer of normals, and one of albedos.
    denoise, keep_noisy
        Whether layers are denoised (see `denoising`), and whether the noisy layers are kept, too.
    pixel_filter
        "box", "tent", "gaussian", "mitchell", "catmullrom" or "lanczos". None: the box for a stage, the film's own
        filter for a Mitsuba scene, and the box if layers are denoised: with other filters the noise of neighbouring
        pixels is alike, and much of it stays.
    program
        A program that changes the beams of each pass, or None.

    Raises
    ------
    SceneError
        If a value is of the wrong type or out of range; the message names the field.
    """

    passes: int = None  # type: ignore[assignment]  # the default depends on `error`
    time_limit: float | None = None
    error: float | None = None
    seed: int = 0
    beams: int | None = None
    max_depth: int | None = None
    rr_depth: int = 5
    hide_emitters: bool = False
    radius: float | None = None
    min_radius: float | None = None
    max_radius: float | None = None
    overlap: float = OVERLAP
    alpha: float = 0.7
    guiding: bool | None = None
    method: str = "auto"
    short: bool = False
    estimator: str = "auto"
    rule: Rule = DEFAULT_RULE
    gather_error: float = 0.002
    surfaces: bool = True
    surface_samples: int | None = None
    normals: bool = False
    albedo: bool = False
    denoise: bool = False
    keep_noisy: bool = False
    pixel_filter: str | None = None
    program: Program | None = None

    def __post_init__(self) -> None:
        if self.passes is None:
            object.__setattr__(self, "passes", usual_passes(self.error))
        self._check_counts()
        self._check_numbers()
        for name in ("hide_emitters", "guiding", "short", "surfaces", *_FLAGS):
            value = getattr(self, name)
            if not isinstance(value, bool | np.bool_) and not (name == "guiding" and value is None):
                raise SceneError(f"{name} is {value!r}: expected True or False")
        if self.keep_noisy and not self.denoise:
            raise SceneError("keep_noisy is True, but denoise is not: expected denoise, too")
        try:
            check_estimator(self.estimator)
        except ValueError as error:
            raise SceneError(str(error)) from None
        if self.method not in METHODS:
            raise SceneError(f"method is {self.method!r}: expected one of {', '.join(METHODS)}")
        if not isinstance(self.rule, Rule):
            raise SceneError(f"rule is {self.rule!r}: expected a Rule, such as gauss_legendre(6)")
        if self.pixel_filter not in (None, *FILTERS):
            raise SceneError(f"pixel_filter is {self.pixel_filter!r}: expected one of {', '.join(FILTERS)}")
        if not (self.program is None or isinstance(self.program, Program)):
            raise SceneError(f"program is {self.program!r}: expected a Program")

    def _check_counts(self) -> None:
        ranges = {
            "passes": (1, _MOST), "beams": (1, MOST_BEAMS), "max_depth": (-1, _MOST), "rr_depth": (1, _MOST),
            "surface_samples": (1, 1 << 10),
        }  # fmt: skip
        for name in ("seed", *ranges):
            value = getattr(self, name)
            if value is None and name in ("beams", "max_depth", "surface_samples"):
                continue
            value = whole(value, name)
            low, high = ranges.get(name, (value, value))
            if not low <= value <= high:
                expected = f"-1 (any) or 0 to {high}" if name == "max_depth" else f"{low} to {high}"
                raise SceneError(f"{name} is {value}: expected {expected}")
            if name == "surface_samples" and value & (value - 1):
                raise SceneError(f"{name} is {value}: expected a power of two")
            object.__setattr__(self, name, value)

    def _check_numbers(self) -> None:
        object.__setattr__(self, "overlap", real(self.overlap, "overlap", above=0.0))
        for name in ("time_limit", "error", "radius", "min_radius", "max_radius"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, Real) and 0 < float(value) < np.inf):
                shown = value if isinstance(value, Real) else repr(value)
                kind = "a positive number of seconds" if name == "time_limit" else "a number above 0"
                raise SceneError(f"{name} is {shown}: expected {kind}")
        if self.min_radius and self.max_radius and self.min_radius > self.max_radius:
            raise SceneError(f"min_radius is {self.min_radius}: expected at most {self.max_radius} (max_radius)")
        if not (isinstance(self.gather_error, Real) and 0 <= self.gather_error < 1):
            raise SceneError(f"gather_error is {self.gather_error!r}: expected a number from 0 (exact) to below 1")
        if not (isinstance(self.alpha, Real) and 0 < self.alpha <= 1):
            raise SceneError(f"alpha is {self.alpha!r}: expected a number above 0 and at most 1")

    @classmethod
    def of(cls, own: Settings | None, given: Mapping[str, Any]) -> Settings:
        """Return the settings `own` (None: the defaults) with the values `given` by name instead of theirs.

        Raises
        ------
        SceneError
            If a name is not a setting, or a value is not valid.
        """
        if not (own is None or isinstance(own, cls)):
            raise SceneError(f"settings is {own!r}: expected Settings")
        names = [each.name for each in fields(cls)]
        for name in given:
            if name not in names:
                near = get_close_matches(name, names, 1) or names
                raise SceneError(f"{name} is not a setting: expected {'one of ' if near[1:] else ''}{', '.join(near)}")
        if own is None:
            return cls(**given)
        if given.get("error") is not None:  # the number of passes in `own` was not meant as a bound
            given = {"passes": usual_passes(given["error"]), **given}
        return replace(own, **given)

    @property
    def filter_name(self) -> str | None:
        """The name of the pixel filter, or None for the scene's own."""
        return "box" if self.denoise and self.pixel_filter is None else self.pixel_filter

    def depth(self, own: int = -1) -> int | None:
        """Return the longest path in edges, None for any; `own` is the value of the scene, −1 for any."""
        longest = own if self.max_depth is None else self.max_depth
        return None if longest == -1 else longest


DEFAULTS = Settings()


def as_passes(settings: Settings) -> Settings:
    """Return settings without those that change no pass: how many passes there are, and what is made of them."""
    return replace(settings, passes=1, time_limit=None, error=None, keep_noisy=False)


class SettingsArguments(TypedDict, total=False):
    """The fields of `Settings`, other than `passes`, that callers may give as keyword arguments."""

    time_limit: float | None
    error: float | None
    seed: int
    beams: int | None
    max_depth: int | None
    rr_depth: int
    hide_emitters: bool
    radius: float | None
    min_radius: float | None
    max_radius: float | None
    overlap: float
    alpha: float
    guiding: bool | None
    method: str
    short: bool
    estimator: str
    rule: Rule
    gather_error: float
    surfaces: bool
    surface_samples: int | None
    normals: bool
    albedo: bool
    denoise: bool
    keep_noisy: bool
    pixel_filter: str | None
    program: Program | None
