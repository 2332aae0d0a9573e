"""Development: how the sums of a frame become its layers and its file's header, possibly on another machine."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..images.frame import Frame
from ..images.plates import Plate
from ..render.films.denoising import Filtered, denoised
from ..render.films.frame_sums import FrameSums
from ..render.films.layers import deep_of, develop
from ..render.films.sums import ALBEDO, PassSums
from ..render.passes import Statistics, known
from ..render.settings import Settings
from ..runtime.files import PathLike
from ..scene import MOST_PIXELS, Array, SceneError
from ..scene import shown as shown_value

_NAME, _SETTINGS = "development", ("albedo", "denoise", "keep_noisy")


@dataclass(frozen=True)
class Development:
    """What is needed to make a picture of the sums of a frame."""

    shape: tuple[int, int]  # height and width in pixels
    groups: Mapping[str, str]  # the layer of each light group
    views: Mapping[str, Mapping[str, Any]]  # the metadata of an EXR's header by the view's name
    settings: Settings = field(default_factory=Settings)  # of which only those in _SETTINGS matter
    plates: Sequence[Array] = ()  # pixels (H, W, 4) that beams are added to, for each view
    plate_fog: bool = False  # whether the fog dims these
    # The first row and column that are shown, and how many: others were rendered for the pixel filter. None: all.
    shown: tuple[int, int, int, int] | None = None
    # Returns what was missing when the frame was read: some of it is only known after the last pass.
    missing: Callable[[], Sequence[str]] = field(default=list, compare=False)
    # Returns the files from which the frame is rendered.
    sources: Callable[[], Iterable[PathLike]] = field(default=list, compare=False)
    # A cache of denoised layers for each view; None: nothing is cached.
    filtered: dict[str, dict[str, Filtered]] | None = field(default=None, compare=False, repr=False)

    def frame(self, sums: FrameSums, statistics: Statistics | None = None) -> Frame:
        """Return the frame of these sums; `statistics` says how it was rendered, as far as that is known."""
        if statistics is None:
            statistics = Statistics(len(sums), sums.beams, sums.tests, error=known(sums.error()))
        with statistics.phase("denoise") if self.settings.denoise else nullcontext():
            whole = [
                self._layers(name, each, statistics.interrupt)
                for name, each in zip(self.views, sums.views, strict=True)
            ]
        top, left, rows, columns = self.shown or (0, 0, *self.shape)
        part = np.s_[top : top + rows, left : left + columns]
        pictures = [{name: np.ascontiguousarray(layer[part]) for name, layer in each.items()} for each in whole]
        for layers, pixels in zip(pictures, self.plates, strict=False):
            layers["rgba"] = Plate(pixels, self.plate_fog).composite(layers, pixels)
        statistics.missing = self.missing()
        about = {"passes": len(sums), **({"missing": [*statistics.missing]} if statistics.missing else {})}
        headers = [{**each, **about} for each in self.views.values()]
        frame = Frame.of(dict(zip(self.views, zip(pictures, headers, strict=True), strict=True)), statistics)
        frame = replace(frame, sources=self.sources)
        for name, each, layers in zip(self.views, sums.views, whole, strict=True):
            deep = deep_of(each, self.shape, layers["beams"])
            if deep is not None:
                frame.deep[name] = deep.part(top, left, rows, columns)
        return frame

    def _layers(self, view: str, sums: PassSums, interrupt: Callable[[], None] | None) -> dict[str, Array]:
        """Return the layers of a view, with what is not shown."""
        known = None if self.filtered is None else self.filtered.setdefault(view, {})
        layers = develop(sums, self.shape, self.groups)
        if self.settings.denoise:  # before the cut: pixels around the shown part help at its edges
            layers = denoised(layers, sums, self.groups, self.settings.keep_noisy, known, interrupt)
        if not self.settings.albedo:
            layers.pop(ALBEDO, None)
        return layers

    def state(self) -> dict[str, Array]:
        """Return this as arrays by name, for `FrameSums.development`."""
        about = {
            "shape": self.shape, "groups": self.groups, "fog": self.plate_fog, "shown": self.shown,
            "missing": [*self.missing()],
            **{name: getattr(self.settings, name) for name in _SETTINGS},
            "views": {name: {key: _plain(value) for key, value in each.items()} for name, each in self.views.items()},
        }  # fmt: skip
        plates = {f"plate {k}": np.asarray(each) for k, each in enumerate(self.plates)}
        return {_NAME: np.array(json.dumps(about)), **plates}

    @classmethod
    def of(cls, state: Mapping[str, Array]) -> Development:
        """Return the development that has this `state`; SceneError for anything else."""
        try:
            about = json.loads(str(state[_NAME]))
            views = {name: {key: _rich(value) for key, value in each.items()} for name, each in about["views"].items()}
            height, width = shape = _whole(about["shape"], 2, 1)
            shown = None if about["shown"] is None else _whole(about["shown"], 4, 0)
            groups = {str(name): str(layer) for name, layer in about["groups"].items()}
            plates = [np.asarray(state[f"plate {k}"]) for k in range(sum(name.startswith("plate ") for name in state))]
            settings: dict[str, Any] = {name: bool(about[name]) for name in _SETTINGS}
            fog, missing = bool(about["fog"]), [str(each) for each in about.get("missing", ())]
        except (KeyError, ValueError, TypeError, AttributeError, ZeroDivisionError, RecursionError) as error:
            raise SceneError(f"does not say how its passes become a picture: {shown_value(error)}") from None
        top, left, rows, columns = shown or (0, 0, *shape)
        if top + rows > height or left + columns > width or not (rows and columns):
            raise SceneError(
                f"shows {columns} x {rows} pixels from {left}, {top} of {width} x {height}: expected a part"
            )
        wanted = (len(views), (rows, columns, 4))
        if plates and {(len(plates), each.shape) for each in plates} != {wanted}:
            raise SceneError(f"has {len(plates)} plates of {plates[0].shape}: expected {wanted[0]} of {wanted[1]}")
        return cls(
            shape=(height, width),
            groups=groups,
            views=views,
            settings=Settings(**settings),
            plates=plates,
            plate_fog=fog,
            shown=shown,  # type: ignore[arg-type]
            missing=lambda: missing,
        )

    def check(self, sums: FrameSums) -> None:
        """Raise SceneError if these sums are not of as many views and pixels as this is."""
        pixels = {each.shape[-1] for own in sums.views for each in own.total().values()}
        if len(self.views) != len(sums.views) or pixels - {self.shape[0] * self.shape[1]}:
            found = f"{len(sums.views)} views of {' and '.join(map(str, sorted(pixels)))} pixels"
            raise SceneError(f"has {found}: expected {len(self.views)} of {self.shape[1]} x {self.shape[0]}")


def developed(sums: FrameSums) -> Frame:
    """Return the frame of sums that hold the state of a development; SceneError if they do not."""
    development = Development.of(sums.development)
    development.check(sums)
    return development.frame(sums)


def _whole(given: Any, count: int, least: int) -> tuple[int, ...]:
    """Return `count` whole numbers of at least `least`; raise ValueError for anything else."""
    values = tuple(given)
    if len(values) != count or not all(isinstance(each, int) and least <= each <= MOST_PIXELS for each in values):
        raise ValueError(f"{values}: expected {count} numbers from {least} to {MOST_PIXELS}")
    return values


def _plain(value: Any) -> Any:
    """Return a header's value in a form that JSON can hold."""
    if isinstance(value, Fraction):
        return {"fraction": [value.numerator, value.denominator]}
    if isinstance(value, np.ndarray):
        return {"matrix": value.tolist()}
    return value.item() if isinstance(value, np.generic) else value


def _rich(value: Any) -> Any:
    """Return the header's value of which `_plain` made `value`."""
    if isinstance(value, dict):
        return Fraction(*value["fraction"]) if "fraction" in value else np.array(value["matrix"])
    return tuple(value) if isinstance(value, list) and not any(isinstance(each, str) for each in value) else value
