"""Denoised layers: Open Image Denoise where it errs less than the passes do.

Open Image Denoise (https://www.openimagedenoise.org) is a network that was trained on the noise of path tracers, which
is independent in each pixel. For surfaces it is guided by albedos and normals, as its documentation asks: seen through
the same pixel filter, and of the first surface that is more than a mirror or clear glass. Beams have no guides: what a
surface behind them looks like would be left in them.

Beams share their light among many pixels, so their noise is of another kind, and after a few passes there is hardly
any. The network may make them worse. A layer is therefore a mixture of two pictures, n of the passes and f of the
network: n + w (f − n). Two properties of d = f − n, each taken over the pixels around, tell noise from the network's
own errors. Both use errors relative to the light; otherwise bright pixels would decide for dark ones beside them. What
is slow in d, a blur of it, and what is fine have weights of their own: noise is fine, the network's errors may be as
slow as a screen is wide, and one weight for both would leave specks of noise where the network is a little too dark.

- Its size. The passes tell how large their error is, σ². Where the network errs by b, the mean of d² is about σ² + b²,
  and w = σ² / (σ² + b²) has the least error of all mixtures (like James and Stein's estimator; Gu et al. 2022, "Neural
  James-Stein Combiner for Unbiased and Biased Renderings"). With more passes w vanishes, and the picture converges to
  the one without denoising.
- Its pattern. Noise differs from pixel to pixel, while a smeared edge is the same error in many pixels. So w falls with
  the correlation of neighbours, and is 0 where that is a third. Otherwise the edges of shafts would be smeared in the
  first passes: σ² also counts that passes look at different places in a pixel, though these errors cancel. Slow
  differences have no such weight: a blur leaves 1/(4π s²) of σ² of them, which is little beside a smeared edge.

What emits light and is seen, also in mirrors and through glass, has no noise and is left out: of lamps a thousand times
brighter than the rest, the network makes green ones. Nor does w go so far that a pixel is brighter than all of the
passes' pixels around.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import convolve, gaussian_filter, maximum_filter, uniform_filter

from ...runtime.device import backend
from ...scene import Array, SceneError
from .layers import emitted_of, surface_layers
from .sums import ALBEDO, MEAN_NORMAL, NOISY, PassSums

# Side of the square of pixels over which errors are averaged: the variance of one pixel over few passes is a guess.
# With a side of 7 the weights are as uneven as the noise, and specks of noise stay.
_AROUND = 15
# A mean over that square counts as this many of its standard errors less: of bright rare specks the square may have
# more or fewer than their number of passes tells, and a network that removes them does not err.
_ERRORS = 4.0
_LEAST = np.finfo(np.float32).tiny
_SLOW = 3.0  # pixels of the Gaussian that tells what is slow in a difference
_CORRELATED = 1 / 3  # correlation of neighbours from which on a difference is not noise at all
_ORDINARY = 1e-6, 1e15  # mean light that needs no scale: below 1e-7 the network returns light of its own
_DARK = 0.01  # fraction of the picture's mean light: errors of darker pixels are relative to this


@dataclass(frozen=True)
class Filtered:
    """The result of Open Image Denoise for a layer; with the same light and guides it can be used again."""

    noisy: Array
    guides: Mapping[str, Array]
    result: Array

    def is_of(self, noisy: Array, guides: Mapping[str, Array]) -> bool:
        """Return whether the result is of the light `noisy` and of these `guides`."""
        return (
            np.array_equal(noisy, self.noisy)
            and guides.keys() == self.guides.keys()
            and all(np.array_equal(guide, self.guides[name]) for name, guide in guides.items())
        )


def check_denoiser() -> None:
    """Raise SceneError if Open Image Denoise cannot be used."""
    _device()


def lacking_denoiser() -> str | None:
    """Return why Open Image Denoise cannot be used, or None if it can be."""
    try:
        check_denoiser()
    except SceneError as error:
        return str(error)
    return None


def denoised(
    layers: Mapping[str, Array], sums: PassSums, groups: Mapping[str, str], keep_noisy: bool = False,
    known: dict[str, Filtered] | None = None, interrupt: Callable[[], None] | None = None,
) -> dict[str, Array]:  # fmt: skip
    """Return the layers of a view, with `surface` and the layers of beams denoised; `rgba` is still their sum.

    Parameters
    ----------
    layers
        The layers that `layers.develop` returns for `sums`.
    sums
        The sums of passes that were rendered to be denoised: they contain albedos, normals and variances.
    groups
        The layer of each light group.
    keep_noisy
        Whether the result also has the noisy layers, by names that begin with "noisy_".
    known
        Earlier results by the names of layers, which are used again and updated; None: nothing is kept.
    interrupt
        Called between parts of the network; an exception from it ends the denoising.

    Raises
    ------
    SceneError
        If Open Image Denoise cannot be used, or the passes were not rendered to be denoised.
    """
    with _interrupted_by(interrupt):
        return _denoised(layers, sums, groups, keep_noisy, known)


def _denoised(
    layers: Mapping[str, Array], sums: PassSums, groups: Mapping[str, str], keep_noisy: bool,
    known: dict[str, Filtered] | None,
) -> dict[str, Array]:  # fmt: skip
    shape = layers["surface"].shape[:2]
    guides, emitted = _guides(sums, shape), emitted_of(sums, shape, groups)
    known = {} if known is None else known
    of_beams = [*dict.fromkeys(groups.values())]
    of_surfaces = [*dict.fromkeys(surface_layers(groups).values())]
    result = {}
    # The error of a single pass is unknown. The noise of surfaces is of the kind that the network removes, that of
    # beams is not.
    for whole, parts, own, unknown in (("surface", of_surfaces, guides, 1.0), ("beams", of_beams, {}, 0.0)):
        for name in parts or [whole]:
            clear = emitted.get(name, np.float32(0))
            result[name] = _mixed(name, layers[name] - clear, own, sums.variance(name), unknown, known) + clear
        if parts:
            rest = layers[whole] - sum(layers[name] for name in parts)
            result[whole] = sum((result[name] for name in parts), rest)
    rgb = result["surface"] + result["beams"]
    kept = ["surface", "beams", *of_beams, *of_surfaces] if keep_noisy else []
    noisy = {NOISY + name: layers[name] for name in kept}
    return {**layers, **result, "rgba": np.concatenate([rgb, layers["rgba"][..., 3:]], axis=2), **noisy}


def _guides(sums: PassSums, shape: tuple[int, ...]) -> dict[str, Array]:
    """Return the means of albedos and normals, (H, W, 3), by the names that Open Image Denoise has for them."""
    total = sums.total((ALBEDO, MEAN_NORMAL, "weight"))
    if MEAN_NORMAL not in total:
        raise SceneError("the passes have no normals to denoise with: expected passes that were rendered with denoise")
    if ALBEDO not in total:  # with a holdout no surface is seen; the network takes no normals without albedos
        return {}
    scale = 1 / total["weight"] if "weight" in total else np.float32(1 / len(sums))
    names = {"albedo": ALBEDO, "normal": MEAN_NORMAL}
    means = {guide: (total[name] * scale).reshape(3, *shape) for guide, name in names.items()}
    return {guide: np.ascontiguousarray(mean.transpose(1, 2, 0)) for guide, mean in means.items()}


def _mixed(
    name: str, noisy: Array, guides: Mapping[str, Array], variance: Array | None, unknown: float,
    known: dict[str, Filtered],
) -> Array:  # fmt: skip
    """Return a layer mixed from the mean of the passes and the network's picture.

    `unknown` is the weight of the latter if no variance is known.
    """
    if not noisy.any() or (variance is None and not unknown):
        return noisy
    scale = _scale(noisy)
    if scale != 1:
        variance = None if variance is None else variance * scale**2
        scaled = (noisy * scale).astype(np.float32)
        return (_mixed(name, scaled, guides, variance, unknown, known) / scale).astype(np.float32)
    if name not in known or not known[name].is_of(noisy, guides):
        known[name] = Filtered(noisy, guides, _filtered(noisy, guides))
    return _mixture(noisy, known[name].result - noisy, variance, unknown)


def _mixture(noisy: Array, change: Array, variance: Array | None, unknown: float) -> Array:
    """Return the light with that part of the network's change that removes noise; arguments as of `_mixed`."""
    taken = unknown * change
    if variance is not None:
        shown = (noisy + change).mean(axis=2)
        usual = np.maximum(shown, _DARK * float(np.maximum(shown.mean(), _LEAST)))
        own = np.maximum(_around(variance.reshape(shown.shape) / usual**2), 0)
        relative = change / usual[..., None]
        slow = gaussian_filter(relative, (_SLOW, _SLOW, 0))
        left, fine = 1 / (4 * np.pi * _SLOW**2), (relative - slow).mean(axis=2)
        likeness = _surely(fine * _beside(fine)) / np.maximum(_CORRELATED * _around(fine**2), _LEAST)
        weight = _noise(own * (1 - left), fine) * np.maximum(1 - likeness, 0)
        kept = weight[..., None] * (relative - slow) + _noise(own * left, slow.mean(axis=2))[..., None] * slow
        taken = usual[..., None] * kept
    room = maximum_filter(noisy, (_AROUND, _AROUND, 1)) - noisy
    most = np.divide(room, taken, out=np.ones_like(taken), where=taken > room).min(axis=2)
    result: Array = noisy + most[..., None] * taken
    return result


def _noise(own: Array, light: Array) -> Array:
    """Return which part of the squares of `light` is noise, from its variance."""
    result: Array = own / np.maximum(np.maximum(_surely(light**2), own), _LEAST)
    return result


def _scale(light: Array) -> np.float64:
    """Return a power of two that makes very dark or very bright light ordinary; 1 for ordinary light."""
    mean = np.abs(light).mean(dtype=np.float64)
    ordinary = _ORDINARY[0] <= mean <= _ORDINARY[1] or not np.isfinite(mean)
    return np.float64(1.0 if ordinary else 2.0 ** -round(np.log2(mean)))


def _around(values: Array) -> Array:
    """Return means over the pixels around each pixel."""
    return uniform_filter(values, _AROUND, mode="reflect")


def _surely(values: Array) -> Array:
    """Return means over the pixels around each pixel, less some standard errors of these: lower bounds, at least 0."""
    mean = _around(values)
    error = np.sqrt(np.maximum(_around(values**2) - mean**2, 0)) / _AROUND
    return np.maximum(mean - _ERRORS * error, 0)


def _beside(values: Array) -> Array:
    """Return means of the four neighbours of each pixel."""
    kernel = np.array([[0, 0.25, 0], [0.25, 0, 0.25], [0, 0.25, 0]], dtype=np.float32)
    return convolve(values, kernel, mode="mirror")  # so that no pixel at an edge is its own neighbour


def _filtered(noisy: Array, guides: Mapping[str, Array]) -> Array:
    """Return the result of Open Image Denoise for (H, W, 3) light."""
    oidn, device = _device()
    color = np.ascontiguousarray(np.maximum(noisy, 0))  # pixel filters with negative lobes may leave negative light
    try:
        return np.asarray(oidn.denoise(color, guides.get("albedo"), guides.get("normal"), hdr=True, device=device))
    except (RuntimeError, ValueError) as error:
        if device.ended is not None:
            raise device.ended from None
        raise _failed(error) from error


class _Device:
    """A device of the library whose filters ask between their parts whether to go on: `interrupt` may raise an error.

    Filters are kept by the library, so that they have one monitor for all calls.
    """

    def __init__(self, device: Any) -> None:
        self._device = device
        self.interrupt: Callable[[], None] | None = None
        self.ended: BaseException | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def new_filter(self, kind: str) -> Any:
        """Return a filter that the device makes, with a monitor."""
        made = self._device.new_filter(kind)
        made.set_progress_monitor(self._goes_on)
        return made

    def _goes_on(self, _done: float) -> bool:
        try:
            if self.interrupt is not None and self.ended is None:
                self.interrupt()
        except BaseException as error:  # whatever ends the frame: it passes through the library, which knows no errors
            self.ended = error
        return self.ended is None


# The library denoises one picture at a time; held, so that one picture's `interrupt` does not end another one.
_DENOISING = threading.RLock()


@contextmanager
def _interrupted_by(interrupt: Callable[[], None] | None) -> Iterator[None]:
    """Let `interrupt` end what is denoised within the context by an exception."""
    with _DENOISING:
        if interrupt is None:
            yield
            return
        _, device = _device()
        device.interrupt, device.ended = interrupt, None
        try:
            yield
        finally:
            device.interrupt = device.ended = None


@lru_cache(maxsize=1)
def _device() -> tuple[Any, Any]:
    """Return the library and its device, the renderer's own processor; raise SceneError if it does not work."""
    try:
        import mitsuba_oidn as oidn

        return oidn, _Device(oidn.Device(oidn.DeviceType.CUDA if backend() == "cuda" else oidn.DeviceType.CPU))
    except (ImportError, OSError, RuntimeError, AttributeError) as error:
        raise _failed(error) from error


def _failed(error: Exception) -> SceneError:
    reason = " ".join(str(error).split())[:200]
    return SceneError(
        f"cannot denoise because Open Image Denoise fails ({reason}): expected a working package mitsuba-oidn"
    )
