"""Check Mitsuba's media and emitters for numbers that Mitsuba accepts but that cannot be rendered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..runtime.device import mitsuba
from ..scene import SceneError

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiMedium, MiMesh, MiObject

mi = mitsuba()


def check_phase(plugin: MiMedium) -> None:
    """Raise SceneError where a medium's phase function depends on more than the angle."""
    phase = plugin.phase_function()
    if mi.has_flag(phase.flags(), mi.PhaseFunctionFlags.Microflake):
        name = plugin.id() or plugin.class_name()
        raise SceneError(
            f"medium {name}: its phase function {phase.class_name()} depends on the orientation of flakes: "
            "expected one that depends on the angle alone"
        )


def wrong_mesh(mesh: MiMesh, triangles: int | None = None) -> str:
    """Return why rays cannot meet a mesh, or all of the `triangles` of its file, as a clause; "" if they can.

    Mitsuba leaves out faces of OBJ files of which it cannot read a corner. Rays that meet a face of a vertex that is
    not there read memory beyond the mesh, and none can be traced in a scene with a mesh without faces.
    """
    count, last = mesh.vertex_count(), np.asarray(mesh.faces_buffer()).max(initial=0)
    if not mesh.face_count():
        return "it has no faces"
    if last >= count:
        return f"a face names vertex {last:,} of a mesh that has {count:,}"
    if triangles not in (None, found := mesh.face_count()):
        expected = "expected corners such as 1, 1/2 or 1/2/3, each face on one line"
        return f"Mitsuba finds {found:,} of its {triangles:,} triangles: {expected}"
    return "" if np.isfinite(np.asarray(mesh.vertex_positions_buffer())).all() else "a vertex is not finite"


def check_numbers(plugin: MiObject, name: str) -> None:
    """Raise SceneError where a number of a medium is not finite, or not in the range of its coefficient."""
    check_finite(plugin, f"medium {name}")
    for key, value in mi.traverse(plugin):
        numbers = _numbers(value)
        if not numbers.size:
            continue
        if key.startswith(("sigma_t.", "albedo.")) and key.endswith((".data", ".value")) and numbers.min() < 0:
            raise SceneError(f"medium {name}: {key} has numbers below 0, such as {numbers.min():g}: expected 0 or more")
        if key.startswith("albedo.") and key.endswith((".data", ".value")) and numbers.max() > 1 + 1e-5:
            raise SceneError(f"medium {name}: {key} has numbers above 1, such as {numbers.max():g}: expected 0 to 1")


def check_finite(plugin: MiObject, name: str) -> None:
    """Raise SceneError where a number of a Mitsuba object, or of its images and grids, is not finite."""
    for key, value in mi.traverse(plugin):
        if not np.all(np.isfinite(_numbers(value))):
            raise SceneError(f"{name}: {key} has numbers that are not finite: expected finite ones")


def _numbers(value: object) -> np.ndarray:
    """Return the numbers of a parameter, an empty array where it has none."""
    value = getattr(value, "matrix", value)
    try:
        return np.asarray(getattr(value, "array", value), dtype=float)
    except (TypeError, ValueError):
        return np.zeros(0)
