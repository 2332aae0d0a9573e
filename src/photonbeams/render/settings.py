"""How a frame is rendered: one record for stages and Mitsuba scenes, made from the arguments and passed on whole.

Each setting is written once, as a field of `Settings`. The command's options, the plug-in's parameters and the tables
of the documentation are made from these fields; hence nothing heavy is imported here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypedDict

from ..constants import DEFAULT_BEAMS, DEFAULT_PATHS, DEFAULT_POINTS, ESTIMATORS, FILTERS, MOST_BEAMS, MOST_POINTS
from ..setting import Setting, setting

if TYPE_CHECKING:
    from ..beams.programs import Program
    from ..quadrature import Rule
else:
    Program = Rule = object  # Dr.Jit looks up the types of a record's fields

# Passes where the user gives no number. With a goal for the error, nearly all frames end before the second number.
_PASSES, _MOST_FOR_ERROR = 16, 4096

METHODS = ("auto", "beams", "paths")

_MOST = 2**31 - 1

# Widths of a beam in the first pass, in distances between neighbours. With it one pass of 4,096 beams of the comparison
# scene is within 1.5 % of the integral in the median, seen from beside (1.0 %) and from inside the shaft (1.4 %, worst
# of three seeds). At 1.5 the inside errs by 3 %; at 2.5 the blur of the shaft's edge costs half a percent of its light.
_OVERLAP = 2.2

_DEPTH = (
    "Longest path in the image, in edges; -1 is no limit. 1 shows only emitters that the camera sees directly, "
    "2 adds light that is scattered once, and so on."
)

_ORDER = {"kind": int, "least": 1, "most": MOST_POINTS, "expected": f"1 to {MOST_POINTS} points"}


def usual_passes(error: float | None) -> int:
    """Return the default number of passes, with a goal for the `error` or without (None)."""
    return _PASSES if error is None else _MOST_FOR_ERROR


def _yes_or_no(help: str, default: bool | None = False, **more: Any) -> Any:
    return setting(default, help, kind=bool, **more)


@dataclass(frozen=True)
class Settings:
    """How a frame is rendered. Where None is allowed, it leaves the choice to the scene, or to its kind.

    The reference has a table of the fields, which is made from what they say of themselves.

    Raises
    ------
    SceneError
        If a value is of the wrong type or out of range; the message names the field.
    """

    passes: int = setting(
        None, f"Number of passes that a frame averages; default: {_PASSES}, or the sampler's count in a Mitsuba scene.",
        {"--passes": {}}, kind=int, least=1, most=_MOST,
    )  # fmt: skip
    time_limit: float | None = setting(
        None, "Begin no further pass of a frame after this many seconds.",
        {"--time-limit": {}}, above=0.0, expected="a positive number of seconds",
    )  # fmt: skip
    error: float | None = setting(
        None, "Relative error at which the render stops: that of pixels, averaged over the middle half of the light.",
        {"--error": {"metavar": "E", "help": "Render until the relative error is E, such as 0.01; "
                     f"at most --passes, by default {_MOST_FOR_ERROR}."}},
        {"error": {}}, above=0.0, below=1.0, expected="more than 0 and less than 1, such as 0.01",
    )  # fmt: skip
    seed: int = setting(
        0, "Random seed, the same for all frames, so that beams do not flicker; default: 0.", {"--seed": {}}, kind=int
    )
    beams: int | None = setting(
        None, f"Beams per pass of each light that sets no number, default: {DEFAULT_BEAMS}; "
        f"for a Mitsuba scene: light paths, default: the integrator's, or {DEFAULT_PATHS}.",
        {"--beams": {}},
        {"paths": {"default": DEFAULT_PATHS, "help": "Light paths in each pass. There are as many passes as samples "
                   "per pixel; in each pass, a pixel has one sample of beams and up to 32 samples of surfaces."}},
        kind=int, least=1, most=MOST_BEAMS,
    )  # fmt: skip
    max_depth: int | None = setting(
        None, _DEPTH + " Default: 2 for a stage, -1 for a Mitsuba scene.",
        {"--bounces": {"metavar": "N", "most": _MOST - 2, "expected": f"0 to {_MOST - 2}, or -1 for no limit", "help":
                       "How often light bounces before its last scattering toward the camera, -1: no limit; "
                       "default: 0, or the integrator's max_depth less 2."}},
        {"max_depth": {"default": -1, "help": _DEPTH}},
        kind=int, least=-1, most=_MOST, expected=f"-1 (any) or 0 to {_MOST}",
    )  # fmt: skip
    rr_depth: int = setting(
        5, "Bounces after which paths may end by Russian roulette.", None, {"rr_depth": {}}, kind=int, least=1,
        most=_MOST,
    )  # fmt: skip
    hide_emitters: bool = _yes_or_no("Hide emitters that the camera sees directly.", parameter={"hide_emitters": {}})
    radius: float | None = setting(
        None, "Radius of all beams in the first pass, in scene units; by default, it follows from photon "
        "differentials.", None, {"radius": {}}, above=0.0,
    )  # fmt: skip
    min_radius: float | None = setting(
        None, "Smallest radius from photon differentials, in scene units; by default, 0.0001 of the radius of the "
        "medium or, for photons, of the scene.", None, {"min_radius": {}}, above=0.0,
    )  # fmt: skip
    max_radius: float | None = setting(
        None, "Largest radius from photon differentials, in scene units; by default, 0.05 of the radius of the medium "
        "or, for photons, of the scene, and at most a quarter of a mean free path (in a grid, of that at the beam). "
        "Photons with more than the usual flux may be wider.",
        None, {"max_radius": {}}, above=0.0,
    )  # fmt: skip
    overlap: float = setting(
        _OVERLAP,
        "Width of a beam, in spacings of its neighbours.",
        None,
        {"overlap": {}},
        above=0.0,
        expected="a finite number above 0",
    )
    alpha: float = setting(
        0.7, "How fast radii shrink from pass to pass: above 0, and at most 1, which keeps them as they are.",
        None, {"alpha": {}}, above=0.0, most=1.0,
    )  # fmt: skip
    guiding: bool | None = _yes_or_no(
        "Run a pilot pass that learns which light the camera sees, and send more light paths there; by default, yes. "
        "On a stage it learns for the cameras of all frames.",
        None,
        parameter={"guiding": {"default": True, "help": "Run a pilot pass that learns which light the camera sees, and "
                               "send more light paths there."}},
    )  # fmt: skip
    method: str = setting(
        "auto", 'How light is found: "beams" traces it from the emitters; "paths" traces paths from the camera, except '
        "in media for emitters that have a look, a portal, a gobo or settings of their beams; "
        '"auto" traces paths to surfaces, and in media whichever a pilot finds to have less noise; on stages, beams, '
        "but in thick smoke paths.",
        None, {"method": {}}, choices=METHODS,
    )  # fmt: skip
    without: frozenset[str] = setting(
        frozenset(), 'Techniques that are not used, such as "walks"; others that can find their light do. '
        "For tests: see the theory.", kind=frozenset,
    )  # fmt: skip
    short: bool = _yes_or_no(
        "End beams where their light is scattered, instead of at the next surface.",
        parameter={"beams": {"default": "long", "choices": ("long", "short"), "help":
                   '"long" beams reach to the next surface, "short" ones end where their light is scattered.'}},
    )  # fmt: skip
    estimator: str = setting(
        "auto",
        '"billboard" (beam x beam 1D), "frustum" (beam x beam 2D, by quadrature), or "auto", which blends the two.',
        {"--estimator": {"help": "Billboard (Beam x Beam 1D), frustum (2D) or their blend; "
                         "default: auto, or the Mitsuba integrator's."}},
        {"estimator": {}}, choices=ESTIMATORS,
    )  # fmt: skip
    rule: Rule = setting(
        None, f"Quadrature rule of the frustum; default: gauss_legendre({DEFAULT_POINTS}).",
        {"--rule": {"choices": ("gauss", "riemann"), "help": "Quadrature rule of the frustum; default: gauss."},
         "--order": {**_ORDER, "help": f"Points of the quadrature rule; default: {DEFAULT_POINTS}, or the Mitsuba "
                     "integrator's."}},
        {"order": {**_ORDER, "default": DEFAULT_POINTS, "help": "Number of points of the Gauss-Legendre quadrature."}},
        kind=object,
    )  # fmt: skip
    gather_error: float = setting(
        0.002, "Approximate relative error that is allowed where fewer rays than pixels see the beams; 0 is exact.",
        {"--gather": {"choices": ("adaptive", "exact"), "help": "Gather beams along every ray (exact) or, where they "
                      "look smooth, along fewer (adaptive, the default)."},
         "--gather-error": {"help": "Largest relative error of gathering along fewer rays, 0: exact; default: 0.002."}},
        {"gather_error": {}}, least=0.0, below=1.0, expected="0 (exact) to less than 1",
    )  # fmt: skip
    surfaces: bool = _yes_or_no("Shade surfaces; if not, only beams are rendered.", True)
    surface_samples: int | None = setting(
        None, "Samples that each pixel has in a pass of everything but beams: a power of two; "
        "by default, as many as cost half of what the beams cost, or as many as pilots find best for each part of the "
        "picture, up to 32.",
        kind=int, least=1, most=1 << 10,
    )  # fmt: skip
    normals: bool = _yes_or_no("Add a layer of normals.")
    albedo: bool = _yes_or_no("Add a layer of albedos.")
    positions: bool = _yes_or_no("Add a layer of positions, in world space.")
    motion: bool = _yes_or_no("Add a layer of motion vectors: pixels that surfaces move until the next frame.")
    crypto_object: bool = _yes_or_no("Add a cryptomatte of objects, by the paths of their prims.")
    crypto_material: bool = _yes_or_no("Add a cryptomatte of materials, by the paths of their prims.")
    deep: bool = _yes_or_no("Find where along each ray the light of beams comes from, for a deep file.")
    denoise: bool = _yes_or_no(
        "Denoise surfaces, and beams where they need it, with Open Image Denoise.",
        flags={"--denoise": {}}, parameter={"denoise": {}},
    )  # fmt: skip
    keep_noisy: bool = _yes_or_no(
        "Also write the layers before denoising: noisy_surface, noisy_beams, ...", flags={"--keep-noisy": {}}
    )
    pixel_filter: str | None = setting(
        None, "Pixel filter; default: that of the render settings, or box; for a Mitsuba scene, its film's.",
        {"--filter": {}}, choices=FILTERS,
    )  # fmt: skip
    program: Program | None = setting(
        None, "A program that changes the beams of each pass.", kind=object, reader="stage"
    )

    def __post_init__(self) -> None:
        if self.passes is None:
            object.__setattr__(self, "passes", usual_passes(self.error))
        for name, own in described():
            value = getattr(self, name)
            if own.kind is not object and not (value is None and own.default is None):
                object.__setattr__(self, name, own.checked(value, name))
        self._check_objects()
        self._check_together()

    def _check_objects(self) -> None:
        from ..quadrature import Rule, gauss_legendre
        from ..scene import SceneError

        if self.rule is None:
            object.__setattr__(self, "rule", gauss_legendre(DEFAULT_POINTS))
        if not isinstance(self.rule, Rule):
            raise SceneError(f"rule is {self.rule!r}: expected a Rule, such as gauss_legendre(6)")
        if self.program is not None:
            from ..beams.programs import Program

            if not isinstance(self.program, Program):
                raise SceneError(f"program is {self.program!r}: expected a Program")

    def _check_together(self) -> None:
        from ..scene import SceneError

        if self.without:
            from ..scene.checks import choice
            from .techniques import Technique

            for each in self.without:
                choice(each, "without", tuple(Technique))
        samples = self.surface_samples
        if samples is not None and samples & (samples - 1):
            raise SceneError(f"surface_samples is {samples}: expected a power of two")
        if self.min_radius and self.max_radius and self.min_radius > self.max_radius:
            raise SceneError(f"min_radius is {self.min_radius}: expected at most {self.max_radius} (max_radius)")
        if self.keep_noisy and not self.denoise:
            raise SceneError("keep_noisy is True, but denoise is not: expected denoise, too")

    @classmethod
    def of(cls, own: Settings | None, given: Mapping[str, Any]) -> Settings:
        """Return the settings `own` (None: the defaults) with the values `given` by name instead of theirs.

        Raises
        ------
        SceneError
            If a name is not a setting, or a value is not valid.
        """
        from ..scene import SceneError

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


def depth_of(bounces: int) -> int:
    """Return `max_depth` for a number of `--bounces`, which is −1 if there is no limit."""
    return -1 if bounces < 0 else bounces + 2


def described() -> Iterator[tuple[str, Setting]]:
    """Yield the name of each field of `Settings`, and what is known of it."""
    for each in fields(Settings):
        yield each.name, each.metadata["setting"]


def flags() -> Iterator[tuple[str, Setting]]:
    """Yield each flag that sets a field of `Settings`, with the name of the field."""
    yield from _more("flags")


def parameters() -> Iterator[tuple[str, Setting]]:
    """Yield each parameter of Mitsuba's plug-in that sets a field of `Settings`, with the name of the field."""
    yield from _more("parameters")


def _more(what: str) -> Iterator[tuple[str, Setting]]:
    for each in fields(Settings):
        for found in each.metadata[what]:
            yield each.name, found


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
    without: frozenset[str]
    short: bool
    estimator: str
    rule: Rule
    gather_error: float
    surfaces: bool
    surface_samples: int | None
    normals: bool
    albedo: bool
    positions: bool
    motion: bool
    crypto_object: bool
    crypto_material: bool
    deep: bool
    denoise: bool
    keep_noisy: bool
    pixel_filter: str | None
    program: Program | None
