"""Volumes of grids: OpenVDB objects, and the smoke of fluid simulations, as UsdVol's Volume prims with their shader."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from .images import Images
from .media import Volume
from .prims import Prim, Told, Values

_VOL = struct.Struct("<3sB5i6f")  # the head of Mitsuba's .vol: float32 values, first along x


class GridFiles:
    """The files of the grids of volumes, by object.

    Parameters
    ----------
    files
        Writes grids without a file.
    """

    def __init__(self, files: Images) -> None:
        self._files = files
        self._found: dict[tuple[str, int, frozenset[str]], dict[str, str] | None] = {}

    def of(self, thing: Any, names: set[str], told: Told) -> dict[str, str] | None:
        """Return the files, by name, of those of an evaluated object's grids that there are; None if it has none."""
        key = thing.original.name_full, thing.data.session_uid, frozenset(names)
        if key not in self._found:
            domain = smoke_of(thing)
            found = self._of_volume(thing, names) if domain is None else self._of_smoke(thing, domain, names)
            if isinstance(found, str):
                told(f"{thing.name} is not rendered: {found}")
            self._found[key] = None if isinstance(found, str) else found
        return self._found[key]

    def forget(self, name: str, number: int) -> None:
        """Forget the grids of an object of this name, or of data of this number."""
        self._found = {key: each for key, each in self._found.items() if name != key[0] and number != key[1]}

    def _of_volume(self, thing: Any, names: set[str]) -> dict[str, str] | str:
        """Return the files of a volume object's grids, or why there are none."""
        grids = thing.data.grids
        if not grids.load():
            return str(grids.error_message or "its file cannot be read")
        if not len(grids):
            return "it has no grids at this frame" if thing.data.filepath else "it has no OpenVDB file"
        file = grids.frame_filepath
        if len(thing.modifiers) or not Path(file).is_file():  # Blender made it, or it is packed
            file = self._files.numbered("grid.vdb")
            if not grids.save(file):
                return "Blender cannot write its grids"
        return dict.fromkeys(names & {each.name for each in grids}, file)

    def _of_smoke(self, thing: Any, domain: Any, names: set[str]) -> dict[str, str] | str:
        """Return the files of a domain's grids, or why there are none."""
        mesh = thing.to_mesh()
        box = np.array([vertex.co[:] for vertex in mesh.vertices])
        thing.to_mesh_clear()
        files = {}
        for name in names if len(box) else ():
            if (values := smoke_grid(domain, name)) is not None:
                files[name] = self._files.stored(vol_of(values, box.min(axis=0), box.max(axis=0)), name, ".vol")
        return files or "it has no smoke at this frame, expected a baked cache"


def smoke_of(thing: Any) -> Any:
    """Return the settings of the domain of smoke or fire that an object is; None if it is none."""
    for each in thing.modifiers:
        if each.type == "FLUID" and each.fluid_type == "DOMAIN" and each.show_render:
            return each.domain_settings if each.domain_settings.domain_type == "GAS" else None
    return None


def scale_of(thing: Any, matrix: Any) -> float:
    """Return the factor on a volume's coefficients: an object's opacity may be the same whatever its size."""
    if thing.type != "VOLUME" or thing.data.render.space != "OBJECT":
        return 1.0
    return 1 / max(float(np.linalg.norm(matrix[:3, :3] @ np.full(3, 3**-0.5))), 1e-30)


def smoke_grid(domain: Any, name: str) -> Any:
    """Return a grid of a domain, (Z, Y, X) or (Z, Y, X, 3), which fills its box; None if it has none."""
    grid: Any = getattr(domain, f"{name}_grid", ())
    if not len(grid):
        return None
    flat: Any = np.empty(len(grid), np.float32)
    grid.foreach_get(flat)
    x, y, z = domain.domain_resolution
    channels = 4 if name == "color" else 1
    finer = round((flat.size / (channels * x * y * z)) ** (1 / 3))  # noise adds detail
    if flat.size != channels * x * y * z * finer**3:
        return None
    values = flat.reshape(finer * z, finer * y, finer * x, channels)
    return values[..., :3] if channels == 4 else values[..., 0]


def vol_of(values: Any, low: Any, high: Any) -> bytes:
    """Return a grid, (Z, Y, X) or (Z, Y, X, 3), which fills a box, as Mitsuba's .vol."""
    z, y, x = values.shape[:3]
    head = _VOL.pack(b"VOL", 3, 1, x, y, z, values[0, 0, 0].size, *low, *high)
    return head + np.ascontiguousarray(values, "<f4").tobytes()


def volume_prims(path: str, matrix: Any, volume: Volume, files: dict[str, str], scale: float) -> list[Prim]:
    """Return the prims of a volume: itself, its fields, and its shader.

    Parameters
    ----------
    volume, files
        Its shader, and the files of its grids by their names.
    scale
        A factor on the coefficients of the shader.
    """
    fields = {"density": volume.density, "color": volume.color, "glow": volume.glow_grid}
    fields = {name: field for name, field in fields.items() if field in files}
    material = f"{path}/Material"
    targets = {"material:binding": [material], **{f"field:{name}": [f"{path}/{name}"] for name in fields}}
    return [
        Prim(path, "Volume", targets=targets, apis=["MaterialBindingAPI"], matrix=matrix.T),
        Prim(material, "Material", sources={"outputs:arnold:volume": f"{material}/Shader.outputs:out"}),
        Prim(f"{material}/Shader", "Shader", _shader(volume, set(fields), scale)),
        *(
            Prim(f"{path}/{name}", "OpenVDBAsset", {"filePath": files[field], "fieldName": field})
            for name, field in fields.items()
        ),
    ]


def _shader(volume: Volume, fields: set[str], scale: float) -> Values:
    """Return the values of Arnold's standard_volume, which has all that a Principled Volume has."""
    extinction = volume.scattering + volume.absorption
    most = float(extinction.max()) or 1.0
    albedo = volume.scattering / np.where(extinction > 0, extinction, 1.0)
    values: Values = {
        "info:id": "arnold:standard_volume",
        "inputs:density": most * scale,
        "inputs:transparent": np.exp(-extinction / most).tolist(),
        "inputs:transparent_depth": 1.0,
        "inputs:scatter": 1.0,
        "inputs:scatter_color": albedo.tolist(),
        "inputs:scatter_anisotropy": volume.anisotropy,
        "inputs:density_channel": "density",
        "inputs:emission_mode": "none",
        "outputs:out": None,
    }  # fmt: skip
    if "color" in fields:
        values["inputs:scatter_color_channel"] = "color"
    if "glow" in fields:
        values |= {
            "inputs:emission": scale, "inputs:emission_color": volume.glow.tolist(),
            "inputs:emission_mode": "blackbody" if volume.kelvin else "channel",
            "inputs:emission_channel": "glow", "inputs:temperature_channel": "glow",
            "inputs:temperature": 1.0, "inputs:blackbody_kelvin": volume.kelvin,
            "inputs:blackbody_intensity": 1.0,
        }  # fmt: skip
    return values
