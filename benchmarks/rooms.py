"""Rooms of others, in Mitsuba's format: means and errors of blocks beside `path` or `volpath` in equal time.

The fog, if one is asked for, fills a box around the scene and the camera. Its extinction follows from the depth of what
the camera sees.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import NamedTemporaryFile
from time import perf_counter
from typing import Any
from xml.etree import ElementTree

import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.runtime.device import mitsuba

BLOCKS = (8, 32)  # pixels, across and down


def report(console: Console, arguments: Sequence[str]) -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks rooms", description=__doc__)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE.xml")
    parser.add_argument("--fog", type=float, default=0.0, help="optical depth as far as half of the camera's rays go")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--seconds", type=float, default=30.0, help="seconds for each picture")
    parser.add_argument("--reference", type=float, default=240.0, help="seconds for the reference, by Mitsuba")
    parser.add_argument("--max-depth", type=int, default=18)
    given = parser.parse_args(arguments)
    for path in given.scenes:
        if given.fog:
            # Beside the scene, whose files have relative names.
            with NamedTemporaryFile("w", suffix=".xml", dir=path.parent) as file:
                file.write(filled(path, given.fog))
                file.flush()
                console.print(measured(Path(file.name), f"{path}, fog {given.fog:g}", given))
        else:
            console.print(measured(path, str(path), given))


def filled(path: Path, depth: float) -> str:
    """Return a scene whose camera is in fog, of this optical depth up to half of what the camera sees."""
    mi = mitsuba()
    plugin, root = mi.load_file(str(path)), ElementTree.parse(path).getroot()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, 4096)
    ray, _ = plugin.sensors()[0].sample_ray(0.0, 0.5, sampler.next_2d(), sampler.next_2d())
    distance = plugin.ray_intersect(ray).t.numpy()
    extinction = depth / float(np.median(distance[np.isfinite(distance)]))
    corners = np.array([np.ravel(plugin.bbox().min), np.ravel(plugin.bbox().max), *ray.o.numpy().T])
    low, high = corners.min(axis=0), corners.max(axis=0)
    center, half = (low + high) / 2, (high - low) / 2 + 0.03 * (high - low).max()
    old = root.get("version", "").startswith("0.")
    sigma, to_world = ("sigmaT", "toWorld") if old else ("sigma_t", "to_world")
    fog = (
        f'<medium type="homogeneous" id="fog of the room"><float name="scale" value="{extinction}"/>'
        f'<rgb name="{sigma}" value="1, 1, 1"/><rgb name="albedo" value="0.9, 0.9, 0.9"/></medium>'
    )
    box = (
        f'<shape type="cube"><transform name="{to_world}">'
        f"<scale {_axes(half)}/><translate {_axes(center)}/></transform>"
        '<bsdf type="null"/><ref name="interior" id="fog of the room"/></shape>'
    )
    sensor = root.find("sensor")
    if sensor is None:
        raise SystemExit(f"{path}: has no sensor")
    root.insert(0, ElementTree.fromstring(fog))
    sensor.append(ElementTree.fromstring('<ref id="fog of the room"/>'))
    root.append(ElementTree.fromstring(box))
    return ElementTree.tostring(root, encoding="unicode")


def _axes(vector: Any) -> str:
    """Return a vector as attributes of XML."""
    return " ".join(f'{axis}="{number}"' for axis, number in zip("xyz", vector, strict=True))


def measured(path: Path, title: str, given: argparse.Namespace) -> Table:
    """Return means and errors of pictures of a scene, against a long render by Mitsuba."""
    mi = mitsuba()
    width, height = given.size
    plugin = mi.load_file(str(path))
    parameters = mi.traverse(plugin)
    parameters[next(each for each in parameters.properties if each.endswith("film.size"))] = [width, height]
    parameters.update()
    kind = "volpath" if given.fog else "path"
    integrator = mi.load_dict({"type": kind, "max_depth": given.max_depth, "rr_depth": 8})
    shot, about = pb.Shot.open(path), {"width": width, "height": height, "max_depth": given.max_depth}

    def mitsubas(seconds: float, seed: int) -> Any:
        total, count, begin = 0.0, 0, perf_counter()
        while not count or perf_counter() - begin < seconds:
            picture = mi.render(plugin, integrator=integrator, spp=8, seed=seed + count)
            total, count = total + np.nan_to_num(np.array(picture)[..., :3]), count + 1
        return total / count

    def ours(denoise: bool) -> Any:
        frame = shot.render(passes=1 << 14, time_limit=given.seconds, denoise=denoise, **about)
        return frame.layers["rgba"][..., :3]

    mitsubas(0, 0)
    shot.render(passes=1, **about)  # compiles
    reference = mitsubas(given.reference, 1)
    rows: dict[str, Callable[[], Any]] = {
        kind: lambda: mitsubas(given.seconds, 1 << 20),
        "photonbeams": lambda: ours(False),
        "denoised": lambda: ours(True),
    }
    table = Table(title=f"{title}, {width} × {height}; errors against {given.reference:g} s of {kind}")
    for name in ("", "seconds", "mean", *(f"{side} px: median, largest" for side in BLOCKS)):
        table.add_column(name, justify="right")
    for name, render in rows.items():
        begin = perf_counter()
        picture = render()
        seconds = perf_counter() - begin
        cells = [f"{seconds:.1f}", f"{picture.mean() / reference.mean():.4f}"]
        for side in BLOCKS:
            error = np.abs(blocks(picture, side) / blocks(reference, side) - 1)
            cells.append(f"{np.median(error):.1%}, {error.max():.0%}")
        table.add_row(name, *cells)
    return table


def blocks(picture: Any, side: int) -> Any:
    """Return the means of a picture's whole blocks of `side` × `side` pixels."""
    rows, columns = (each // side for each in picture.shape[:2])
    whole = picture[: rows * side, : columns * side].reshape(rows, side, columns, side, -1)
    return np.maximum(whole.mean(axis=(1, 3, 4)), 1e-6)
