"""A blind of slats before a lamp in fog, anywhere and of any size, and how dark its stripes are in a picture."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Blind:
    """Slats that stand upright, `count` gaps of `gap` scene units with slats of the same width between them.

    The lamp is `away` before the middle of the blind, at `place`, and the camera looks straight down on the light that
    is as far behind it.
    """

    gap: float
    away: float
    place: tuple[float, float, float]
    count: int = 5
    meters: float = 1.0
    radius: float = 1e-3  # of the lamp, in its distances
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)  # all of it, in degrees about its axes

    @property
    def _half(self) -> float:
        return (self.count - 0.5) * self.gap

    def stage(self) -> str:
        """Return the stage as text."""
        half, tall, wide = self._half, 3 * self.away, 40 * self.away
        edges = [(-wide, -half - self.gap)]
        edges += [(2 * k * self.gap - half, (2 * k + 1) * self.gap - half) for k in range(self.count - 1)]
        edges = [(-wide, -half), *((a + self.gap, b + self.gap) for a, b in edges[1:]), (half, wide)]
        points = [(x, y, 0.0) for a, b in edges for x, y in ((a, -tall), (b, -tall), (b, tall), (a, tall))]
        sizes = ", ".join("4" for _ in edges)
        names = ", ".join(map(str, range(len(points))))
        where = ", ".join(f"({x:.9g}, {y:.9g}, {z:.9g})" for x, y, z in points)
        x, y, z = self.place
        high = 0.9 * self.away
        far = 6 * half  # across the picture: stripes are twice as far apart there as the gaps
        return f"""#usda 1.0
(
    metersPerUnit = {self.meters}
)
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {{
    color3f photonbeams:scattering = ({0.1 / self.away}, {0.1 / self.away}, {0.1 / self.away})
}}
def Xform "Room" {{
    double3 xformOp:translate = ({x}, {y}, {z})
    float3 xformOp:rotateXYZ = ({", ".join(f"{each:.9g}" for each in self.turned)})
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    def Mesh "Blind" {{
        int[] faceVertexCounts = [{sizes}]
        int[] faceVertexIndices = [{names}]
        point3f[] points = [{where}]
        uniform token subdivisionScheme = "none"
        bool doubleSided = 1
    }}
    def SphereLight "Lamp" {{
        float inputs:radius = {self.radius * self.away}
        float inputs:intensity = {10 / self.radius**2}
        double3 xformOp:translate = (0, 0, {self.away})
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def Camera "Camera" {{
        token projection = "orthographic"
        float horizontalAperture = {10 * far}
        float verticalAperture = {10 * far / 4}
        float2 clippingRange = (0.001, {10 * self.away})
        double3 xformOp:translate = (0, {high}, {-self.away})
        float3 xformOp:rotateXYZ = (-90, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }}
}}
"""


def contrast(beams: np.ndarray, fine: np.ndarray) -> float:
    """Return the contrast of the stripes of beams, relative to those of a picture with far finer ones."""
    found, expected = (each.sum(axis=(0, 2)) for each in (beams, fine))
    return float(np.polyfit(expected, found, 1)[0])
