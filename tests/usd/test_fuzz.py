"""Stages with one random error: the rest is read, or one sentence says why it cannot be read."""

from __future__ import annotations

import logging
import random
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd

from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST
from photonbeams.usd.common.reading import quiet
from photonbeams.usd.groups import groups_at_all_times, makers_at_all_times
from photonbeams.usd.settings import read_settings
from photonbeams.usd.stage import default_time, read_camera, read_scene
from tests.helpers.full_stage import STAGE
from tests.helpers.sweep import sweep

SEEDS = {"some": range(80), "more": range(80, 250)}
WRONG = [
    ("float", float("nan")), ("float", float("inf")), ("float", -1.0), ("float", 3e38), ("double", 1e300), ("int", -7),
    ("int", 2**31 - 1), ("bool", True), ("string", "text"), ("token", ""), ("asset", Sdf.AssetPath("gone.exr")),
    ("float3", (float("nan"), 0, 0)), ("color3f", (-1, 0, 0)), ("float[]", []), ("float[]", [1.0, float("nan")]),
    ("point3f[]", [(0, 0, 0)]), ("point3f[]", [(3e38, 0, 0)] * 5), ("int[]", [-1]), ("int[]", [2**31 - 1] * 3),
    ("int[]", [3, 3, 3, 3]), ("token[]", ["nope"]), ("string[]", ["a", "b"]), ("matrix4d", Gf.Matrix4d(0.0)),
    ("float2[]", [(0, 0)] * 7), ("half", 1.0), ("timecode", Sdf.TimeCode(1)),
]  # fmt: skip
TARGETS = ["/Gone", "/Mesh", "/Mesh.points", "/Look", "/Fog", "/Copies", "/Camera"]
KINDS = ["Mesh", "Xform", "SphereLight", "Camera", "PointInstancer", "BasisCurves", "Material", "Shader", "Unknown", ""]


def specs(layer: Sdf.Layer) -> list[Sdf.Spec]:
    """Return all prims and properties of a layer."""
    paths: list[Sdf.Path] = []
    layer.Traverse("/", paths.append)
    return [layer.GetObjectAtPath(path) for path in paths if path.IsPrimPath() or path.IsPropertyPath()]


def mutate(layer: Sdf.Layer, chance: random.Random) -> str:
    """Change a layer in one place, and return what was changed."""
    spec = chance.choice(specs(layer))
    path = spec.path
    if isinstance(spec, Sdf.PrimSpec):
        kind = chance.choice(KINDS)
        if kind:
            spec.typeName = kind
        else:
            del layer.GetPrimAtPath(path.GetParentPath()).nameChildren[spec.name]
        return f"{path} is a {kind or 'prim no longer'}"
    owner = spec.owner
    owner.RemoveProperty(spec)
    if chance.random() < 0.1:
        return f"{path} is gone"
    if chance.random() < 0.3:
        target = chance.choice(TARGETS)
        made = Sdf.RelationshipSpec(owner, path.name, custom=True)
        made.targetPathList.explicitItems = [target]
        return f"{path} names {target}"
    kind, value = chance.choice(WRONG)
    made = Sdf.AttributeSpec(owner, path.name, Sdf.ValueTypeNames.Find(kind))
    if chance.random() < 0.3:
        layer.SetTimeSample(made.path, 1.0, value)
    else:
        made.default = value
    return f"{path} is {kind} {value}"


def arrays(value: object) -> Iterator[np.ndarray]:
    """Yield all numbers of a scene as arrays."""
    if is_dataclass(value):
        yield from (array for each in fields(value) for array in arrays(getattr(value, each.name)))
    elif isinstance(value, (tuple, list)):
        yield from (array for each in value for array in arrays(each))
    elif isinstance(value, (float, np.ndarray)):
        yield np.asarray(value)


@pytest.mark.parametrize("seeds", sweep(SEEDS, ["some"]))
def test_a_stage_that_is_wrong_in_one_place_is_read_without_it(seeds, caplog, capfd):
    caplog.set_level(logging.WARNING, "photonbeams")
    for seed in SEEDS[seeds]:
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.ImportFromString(STAGE)
        with quiet():
            what = mutate(layer, random.Random(seed))
        stage = Usd.Stage.Open(layer)
        caplog.clear()
        try:
            scene = read_scene(stage, default_time(stage))
            numbers = [each for each in arrays(scene) if each.dtype.kind == "f"]
            # A single number may be infinite, as the distance of a shadow is.
            assert all(np.isfinite(each).all() if each.ndim else not np.isnan(each) for each in numbers), (seed, what)
            assert scene.meshes and scene.lights, (seed, what)
        except Exception as error:
            raise AssertionError((seed, what)) from error
        for read in (read_camera, read_settings, groups_at_all_times, makers_at_all_times):
            try:
                read(stage)
            except SceneError as error:
                assert len(str(error)) <= LONGEST
        for record in caplog.records:
            assert len(record.getMessage()) <= LONGEST, (seed, what)
    assert capfd.readouterr().err == ""
