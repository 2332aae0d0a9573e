"""Render the pictures of docs/: a swatch of every look, error against the number of points, and the examples.

`make pictures` runs it. A swatch shows what one factor does, with the others plain: beams as `estimate` sees them, and
the factor's curve.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import drjit as dr
import gallery
import matplotlib.pyplot as plt
import notebooks
import numpy as np
import renders
import studio_pictures
from pages import DOCS, ROOT

import photonbeams as pb
from photonbeams.cli import main as photonbeams
from photonbeams.cli.quadrature import quadrature
from photonbeams.images.swatches import FOG, picture, plot_colors, side_by_side
from photonbeams.runtime.device import Array3f, Float
from photonbeams.runtime.files import atomic_path

PICTURES = DOCS / "pictures"
WIDTH, HEIGHT, DPI = 6.0, 1.25, 214  # inches, dots an inch

_RAMP = "[0, 0.35, 0.65, 1], [[1, 0.95, 0.8], [1, 0.6, 0.2], [0.8, 0.15, 0.1], [0.2, 0.05, 0.3]]"
PAINTED = np.array([[1, 0.9, 0.6], [0.9, 0.5, 0.2], [1, 0.8, 0.5], [0.7, 0.3, 0.4], [0.9, 0.5, 0.6], [0.3, 0.1, 0.4]])

#: Swatches by file name, each the Python that docs/looks.md shows.
ALONG = {
    "attenuation": "pb.looks.Attenuation()",
    "exponential": "pb.looks.Exponential([2.0, 1.2, 0.7])",
    "power": "pb.looks.Power(exponent=2.0, length=0.8)",
    "polynomial": "pb.looks.Polynomial([1, 0, -1])",
    "texture": "pb.looks.Texture(PAINTED)",
    "product": f"pb.looks.ColorRamp({_RAMP}) * pb.looks.Attenuation()",
    "fade": "pb.looks.Fade(inner=1.0, outer=3.5)",
    "expression": "pb.looks.Expression('[1, 0.8, 0.5] * (0.2 + pulse(6 * s, 0.6)) * (1 - s)')",
    **{f"ramp-{kind}": f"pb.looks.ColorRamp({_RAMP}, '{kind}')"
       for kind in ("none", "linear", "smooth", "catmull-rom", "monotone")},
}  # fmt: skip
ACROSS = {
    "uniform": "pb.looks.Uniform()",
    "epanechnikov": "pb.looks.Epanechnikov()",
    "biweight": "pb.looks.Biweight()",
    "gaussian": "pb.looks.Gaussian(width=0.35)",
    "smoothstep-0": "pb.looks.Smoothstep(hardness=0.0)",
    "smoothstep-0.7": "pb.looks.Smoothstep(hardness=0.7)",
    "tabulated": "pb.looks.Tabulated([0.1, 0.2, 1.0, 0.6, 0.0])",
    "hollow": "pb.looks.Hollow(inner=0.6, softness=0.8)",
    "ramp": f"pb.looks.Biweight() * pb.looks.ColorRamp({_RAMP}, space='radius')",
    "noise": "pb.looks.Biweight() * pb.looks.Noise(scale=0.5)",
    "expression": "pb.looks.Uniform() * pb.looks.Expression('smoothstep(0, 0.3, 0.75 + 0.5 * snoise(2.5 * P) - r)')",
}
EYE = {
    "attenuation": "pb.looks.Attenuation()",
    "none": "1.0",
    "exponential": "pb.looks.Exponential(1.5)",
    "ramp": f"pb.looks.ColorRamp({_RAMP}, 'smooth', begin=0, end=6, space='distance')",
}
ANGLE = {
    "scattering": "pb.looks.Scattering()",
    "isotropic": "pb.looks.Isotropic()",
    "glow": "pb.looks.Glow(anisotropy=0.8, mix=0.5, gain=1.0)",
    "ramp": f"pb.looks.Isotropic() * pb.looks.ColorRamp({_RAMP}, 'smooth', begin=0, end=180, space='angle')",
}


def value(expression: str) -> Any:
    """Return what an expression of this file makes."""
    return eval(expression)


# -- what is seen ----------------------------------------------------------------------------------------------------


def side_view(look: pb.Look, width: float) -> Any:
    """Return a beam from the side, four scene units long, that opens from left to right; `width` is in inches."""
    beams = pb.Beams([[0, 0, -0.8]], [[4, 0, -0.8]], 0.15, 0.4, [[1, 1, 1]])
    step = 4.3 / (width * DPI)
    y = (np.arange(int(HEIGHT * DPI)) - HEIGHT * DPI / 2 + 0.5) * -step
    x = -0.15 + step * (np.arange(int(width * DPI)) + 0.5)
    return picture(look, beams, x, y, scale=14.0)


def cross_section(look: pb.Look) -> Any:
    """Return a short piece of a beam from its end."""
    beams = pb.Beams([[0, 0, -0.1]], [[0, 0, -0.2]], 1.0, 1.0, [[1, 1, 1]])
    x = np.linspace(-1.15, 1.15, int(HEIGHT * DPI))
    return picture(look, beams, x, -x, scale=130.0)


def row(look: pb.Look, width: float, depths: Any, angles: Any, medium: pb.Medium, scale: float) -> Any:
    """Return beams of one size side by side; `width` is in inches."""
    return side_by_side(look, depths, angles, int(width * DPI), int(HEIGHT * DPI), medium, scale)


# -- swatches --------------------------------------------------------------------------------------------------------


def along(factor: Any) -> Any:
    """Draw a falloff along the beam."""
    look = pb.Look(along=factor, eye=1.0, angle=pb.looks.Isotropic())
    figure, panels, curve = sheet(3.9)
    show(panels[0], side_view(look, 3.9))
    s = np.linspace(0, 4, 513)
    x = Float(s)
    lines(curve, s, look.bind(FOG, 4.0).along(x, x, x / 4))
    label(curve, "s", (0, 4), 1.05)
    return figure


def across(profile: Any) -> Any:
    """Draw a profile: from the side, from the end, and as a curve, with its line projection dashed."""
    look = pb.Look(along=1.0, across=profile, eye=1.0, angle=pb.looks.Isotropic())
    figure, panels, curve = sheet(2.6, HEIGHT)
    show(panels[0], side_view(look, 2.6))
    show(panels[1], cross_section(look))
    rho = np.linspace(-1, 1, 513)
    x = Float(rho * rho)
    curve.plot(rho, (look.across.density(x) + dr.zeros(Float, len(rho))).numpy(), color="0.15")
    curve.plot(rho, (look.across.line(x) * dr.sqrt(1 - x)).numpy(), color="0.15", ls="--", lw=1)
    label(curve, "ρ", (-1, 1), 1.6)
    return figure


def eye(factor: Any) -> Any:
    """Draw a change toward the camera: beams at growing distances."""
    depths = np.linspace(0.5, 5.5, 6)
    look = pb.Look(along=1.0, eye=factor, angle=pb.looks.Isotropic())
    figure, panels, curve = sheet(3.9)
    show(panels[0], row(look, 3.9, depths, np.full(6, 90.0), FOG, 9.0), [f"{depth:g}" for depth in depths])
    t = np.linspace(0, 6, 513)
    lines(curve, t, look.bind(FOG, 4.0).eye(Float(t), Float(t)))
    label(curve, "t", (0, 6), 1.05)
    return figure


def angle(factor: Any) -> Any:
    """Draw view-angle shading: beams that point toward the camera, past it, and away."""
    medium = pb.Medium(FOG.scattering, FOG.absorption, anisotropy=0.5)
    angles = np.array([15, 40, 65, 90, 115, 140])
    look = pb.Look(along=1.0, eye=1.0, angle=factor)
    figure, panels, curve = sheet(3.9)
    show(panels[0], row(look, 3.9, np.full(6, 3.0), angles, medium, 4.0), [f"{each}°" for each in angles])
    theta = np.linspace(0, 180, 513)
    lines(curve, theta, look.bind(medium, 4.0).angle(Float(np.cos(np.radians(theta)))))
    label(curve, "θ", (0, 180), None)
    return figure


def sheet(*widths: float) -> tuple[Any, list[Any], Any]:
    """Return a figure, a panel for a picture of each width, and one for the curve in what is left."""
    figure = plt.figure(figsize=(WIDTH, HEIGHT), dpi=DPI)
    panels, left = [], 0.0
    for width in widths:
        panels.append(figure.add_axes((left / WIDTH, 0, width / WIDTH, 1)))
        left += width + 0.04
    gap = 0.32
    curve = figure.add_axes(((left + gap) / WIDTH, 0.17, (WIDTH - left - gap - 0.12) / WIDTH, 0.78))
    return figure, panels, curve


def show(panel: Any, pixels: Any, names: Any = ()) -> None:
    """Put a picture into a panel of as many dots, and names under its beams."""
    panel.imshow(pixels, aspect="auto", interpolation="nearest")
    panel.set_axis_off()
    for i, name in enumerate(names):
        place = ((i + 0.5) / len(names), 0.03)
        panel.annotate(name, place, xycoords="axes fraction", ha="center", color="0.75", fontsize=6)


def lines(curve: Any, x: Any, values: Any) -> None:
    """Plot a number, or red, green and blue where they differ."""
    plot_colors(curve, x, (dr.zeros(Array3f, len(x)) + values).numpy())


def label(curve: Any, name: str, limits: tuple[float, float], top: float | None) -> None:
    """Name the axis of a curve."""
    curve.set_xlim(*limits)
    curve.set_ylim(0, top)
    curve.tick_params(labelsize=6, length=2, pad=1)
    curve.annotate(name, (0.97, 0.9), xycoords="axes fraction", ha="right", va="top", fontsize=8, style="italic")
    curve.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Write all pictures."""
    groups: list[tuple[str, dict[str, str], Callable[[Any], Any]]] = [
        ("along", ALONG, along), ("across", ACROSS, across), ("eye", EYE, eye), ("angle", ANGLE, angle)
    ]  # fmt: skip
    with mpl.rc_context({"lines.linewidth": 1.2, "axes.linewidth": 0.6}):
        for group, swatches, draw in groups:
            for name, expression in swatches.items():
                figure = draw(value(expression))
                with atomic_path(PICTURES / f"{group}-{name}.png") as path:
                    figure.savefig(path)
                plt.close(figure)
    for name in ("Ember", "Dust", "Laser", "Tube", "Pulses", "Torn"):
        library, target = str(ROOT / "examples" / "looks" / "looks.usda"), str(PICTURES / f"swatch-{name.lower()}.png")
        with suppress(SystemExit):
            photonbeams(["swatch", library, "--look", name, "-o", target])
    quadrature(plot=PICTURES / "quadrature.png")
    renders.main()
    gallery.main()
    notebooks.main()
    studio_pictures.main()


if __name__ == "__main__":
    main()
