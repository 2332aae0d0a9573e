"""Pictures of looks: beams as `estimate` renders them, and the curves of the factors.

Pictures are (H, W, 3) arrays, sRGB from 0 to 1; figures are Matplotlib's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..estimators.estimate import estimate
from ..looks import BoundLook, LightContext, Look, ShadingContext
from ..runtime.device import Array3f, Float
from ..scene import Medium
from ..scene.extras import needs
from .display import srgb_encoded, tone_mapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..looks.factors import Value

#: The fog in which a look is shown by itself: its scattering is grey, and it absorbs blue the most.
FOG = Medium(scattering=0.2, absorption=(0.03, 0.13, 0.28))

# Sizes in inches.
_WIDTH = 8.0
_BEAM_HEIGHT = 1.6
_CURVE_HEIGHT = 1.15
_TITLE = 0.24  # height
_DPI = 150
_SECTION = 1.6
_SAMPLES = 513


@dataclass(frozen=True)
class Specimen:
    """The beam that a look is shown on: it lies along +x from the origin and opens from left to right."""

    medium: Medium = FOG
    length: float = 4.0
    radius_start: float = 0.15
    radius_end: float = 0.4
    context: LightContext | None = None

    @property
    def beams(self) -> Beams:
        """The beam."""
        return Beams([[0, 0, 0]], [[self.length, 0, 0]], self.radius_start, self.radius_end, [[1, 1, 1]])

    def bind(self, look: Look) -> BoundLook:
        """Return the look bound to the specimen's beam."""
        box = ((0, -self.radius_end, -self.radius_end), (self.length, self.radius_end, self.radius_end))
        return look.bind(self.medium, self.length, self.context, box)


def picture(
    look: Look, beams: Beams, x: np.ndarray, y: np.ndarray, medium: Medium = FOG, scale: float | None = None,
    **given: Any,
) -> np.ndarray:  # fmt: skip
    """Return a picture of beams by parallel rays along −z, at x (W,) and y (H,), the top first, from in front of all.

    `scale` is a factor on radiances; None chooses one that makes the picture bright. `given` goes to `estimate`.
    """
    across, down = np.meshgrid(x, y)
    ends: list[Any] = [beams.start.z + beams.radius_start, beams.end.z + beams.radius_end]
    near = float(dr.max(dr.maximum(*ends))[0])
    origin = np.stack([across.ravel(), down.ravel(), np.full(across.size, max(near, 0.0))], axis=1)
    radiance = estimate(beams, origin, [[0, 0, -1]], look=look, medium=medium, **given).numpy()
    if scale is None:
        brightest = float(np.quantile(radiance.max(axis=1), 0.98))
        scale = 0.7 / brightest if brightest > 0 else 1.0
    return srgb_encoded(tone_mapped(scale * radiance.reshape(*across.shape, 3)))


def from_the_side(look: Look, specimen: Specimen, width: int, height: int) -> np.ndarray:
    """Return a picture of a beam from the side, with the light on the left."""
    margin = 0.04 * specimen.length
    step = (specimen.length + 2 * margin) / width
    x, y = (np.arange(width) + 0.5) * step - margin, (height / 2 - 0.5 - np.arange(height)) * step
    return picture(look, specimen.beams, x, y, specimen.medium, context=specimen.context)


def cross_section(look: Look, specimen: Specimen, size: int) -> np.ndarray:
    """Return a picture of a thin slice of a beam, half way along it, seen from the beam's end."""
    radius = 0.5 * (specimen.radius_start + specimen.radius_end)
    middle, half = 0.5 * specimen.length, 0.01 * radius
    slice_ = Beams(
        [[0, 0, half]], [[0, 0, -half]], radius, radius, [[1, 1, 1]], offset=middle - half, total=specimen.length
    )
    x = np.linspace(-1.15, 1.15, size) * radius
    return picture(look, slice_, x, -x, specimen.medium, context=specimen.context)


def side_by_side(
    look: Look, depths: Sequence[float], angles: Sequence[float], width: int, height: int, medium: Medium = FOG,
    scale: float | None = None,
) -> np.ndarray:  # fmt: skip
    """Return a picture of beams of one size in a row, at these depths and at these scattering angles in degrees.

    At 90° a beam is upright, at smaller angles it points toward the camera, at larger ones away; lengths are such that
    all look equally tall. The picture is as many scene units wide as there are beams.
    """
    count, turn = len(depths), np.radians(angles)
    middle = np.column_stack([np.arange(count) - (count - 1) / 2, np.zeros(count), np.negative(depths)])
    half = np.column_stack([np.zeros(count), np.full(count, 0.5), 0.5 * np.cos(turn) / np.sin(turn)])
    beams = Beams(middle - half, middle + half, 0.16, 0.16, [[1, 1, 1]])
    step = count / width
    x = (np.arange(width) + 0.5) * step - count / 2
    y = (np.arange(height) - height / 2 + 0.5) * -step
    return picture(look, beams, x, y, medium, scale)


def thumbnail(look: Look, factor: str, width: int, height: int) -> np.ndarray:
    """Return a small picture that suits a look's factor; for names without one of their own, a beam from the side."""
    if factor == "eye":
        return side_by_side(look, np.linspace(0.5, 5.5, 5).tolist(), [90.0] * 5, width, height)
    if factor == "angle":
        forward = Medium(FOG.scattering, FOG.absorption, anisotropy=0.5)
        return side_by_side(look, [3.0] * 5, [20, 55, 90, 115, 140], width, height, forward)
    specimen = Specimen(radius_start=0.35, radius_end=0.75)
    if factor == "across":
        side, section = from_the_side(look, specimen, width - height, height), cross_section(look, specimen, height)
        return np.concatenate([side, section], axis=1)
    return from_the_side(look, specimen, width, height)


def sheet(looks: Sequence[tuple[str, Look, Specimen]]) -> Figure:
    """Return a figure of named looks, one below the other: each from the side, in section, and its factors' curves."""
    with needs("plot", "a picture of looks", "matplotlib"):
        from matplotlib.figure import Figure

    row = _TITLE + _BEAM_HEIGHT + _CURVE_HEIGHT + 0.35
    figure = Figure(figsize=(_WIDTH, row * len(looks)), dpi=_DPI)
    for number, (name, look, specimen) in enumerate(looks):
        _row(figure, name, look, specimen, row * (len(looks) - 1 - number), row * len(looks))
    return figure


def _row(figure: Figure, name: str, look: Look, specimen: Specimen, bottom: float, height: float) -> None:
    """Draw a look into a figure of some `height`, `bottom` inches above its lower edge."""

    def panel(left: float, low: float, width: float, high: float) -> Axes:
        return figure.add_axes((left / _WIDTH, (bottom + low) / height, width / _WIDTH, high / height))

    low = _CURVE_HEIGHT + 0.35
    figure.text(0.08 / _WIDTH, (bottom + low + _BEAM_HEIGHT + 0.07) / height, name, fontsize=8, weight="bold")
    wide = _WIDTH - _SECTION - 0.04
    side = from_the_side(look, specimen, round(wide * _DPI), round(_BEAM_HEIGHT * _DPI))
    section = cross_section(look, specimen, round(_SECTION * _DPI))
    for place, pixels in (
        (panel(0, low, wide, _BEAM_HEIGHT), side),
        (panel(wide + 0.04, low, _SECTION, _BEAM_HEIGHT), section),
    ):
        place.imshow(pixels, aspect="auto", interpolation="nearest")
        place.set_axis_off()
    each = _WIDTH / 4
    for number, (title, x, values, rest) in enumerate(curves(specimen.bind(look), specimen)):
        plot(panel(number * each + 0.3, 0.22, each - 0.38, _CURVE_HEIGHT), title, x, values, rest)


def curves(look: BoundLook, specimen: Specimen) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray | None]]:
    """Return the curves of the factors: title, x (N,), values (3, N), and the values of a second curve or None.

    The factor along is over the distance from the light; across over the radius, half way along, with the profile's
    line projection as the second curve; eye over the distance to the camera, up to the beam's length; angle over
    degrees.
    """
    s = np.linspace(0, specimen.length, _SAMPLES)
    middle = 0.5 * specimen.length

    def place(x: np.ndarray) -> ShadingContext:
        distance = Float(x)
        return look.at(
            distance=distance, depth=distance, from_light=distance, fraction=distance * (1 / specimen.length),
            place=lambda: Array3f(distance, 0, 0), beam=SimpleNamespace(identity=Array3f(0.5, 0, 0)),
        )  # fmt: skip

    rho = np.linspace(0, 1, _SAMPLES)
    half_way = place(np.full(_SAMPLES, middle))
    across = _colors(look.factor("across", half_way, rho2=Float(rho * rho))) * np.asarray(
        look.profile.density(Float(rho * rho)) + dr.zeros(Float, _SAMPLES)
    )
    line = np.asarray(look.profile.line(Float(rho * rho)) * dr.sqrt(1 - Float(rho * rho)))
    to_camera, degrees = Float(s), np.linspace(0, 180, _SAMPLES)
    eye = look.factor("eye", half_way, distance=to_camera, depth=to_camera, to_camera=to_camera)
    angle = look.factor("angle", half_way, cosine=Float(np.cos(np.radians(degrees))))
    return [
        ("along, by distance", s, _colors(look.factor("along", place(s))), None),
        ("across, by radius", rho, across, line),
        ("eye, by distance", s, _colors(eye), None),
        ("angle, in degrees", degrees, _colors(angle), None),
    ]


def _colors(values: Value) -> np.ndarray:
    return np.asarray(dr.zeros(Array3f, _SAMPLES) + values, dtype=float)


def plot_colors(axes: Axes, x: np.ndarray, values: np.ndarray) -> None:
    """Plot colours (3, N) as red, green and blue lines, or as one line if the channels are equal."""
    same = np.allclose(values, values[0])
    channels = values[:1] if same else values
    for channel, color in zip(channels, ("0.15",) if same else ("#c33", "#393", "#33c"), strict=True):
        axes.plot(x, channel, color=color, linewidth=1.2)


def plot(axes: Axes, title: str, x: np.ndarray, values: np.ndarray, second: np.ndarray | None = None) -> None:
    """Plot colours (3, N) below a title, and a second curve as a dashed line."""
    plot_colors(axes, x, values)
    if second is not None:
        axes.plot(x, second, color="0.5", linewidth=1, linestyle="--")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(0, None)
    axes.tick_params(labelsize=6, length=2, pad=1)
    axes.set_title(title, fontsize=7, pad=2)
    axes.spines[["top", "right"]].set_visible(False)
