"""`photonbeams render`: frames of a stage or a Mitsuba scene, as layered EXRs and pictures."""

from __future__ import annotations

from .job import run
from .request import RenderRequest


def render(request: RenderRequest) -> None:
    """Render frames of a USD stage or a Mitsuba scene.

    For example:

    photonbeams render shot.usda -o out/shot.####.exr -f 1001:1048

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64

    photonbeams render cornell.xml -o cornell.exr --passes 64 --checkpoint 60
    """
    run(request)
