"""Mitsuba scenes with an error in one random place are built, or refused with a sentence that says why."""

import logging
import random
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render.scene_frame import begin
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST
from tests.helpers.sweep import sweep

mi = mitsuba()

SCENE = """<scene version="3.0.0">
    <integrator type="photon_beams">
        <integer name="max_depth" value="4"/>
        <integer name="paths" value="64"/>
        <boolean name="guiding" value="false"/>
        <string name="method" value="beams"/>
    </integrator>
    <medium type="homogeneous" id="fog">
        <rgb name="albedo" value="0.5, 0.6, 0.7"/>
        <float name="sigma_t" value="0.4"/>
        <phase type="hg"><float name="g" value="0.3"/></phase>
    </medium>
    <sensor type="perspective">
        <float name="fov" value="45"/>
        <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="8"/>
            <integer name="height" value="8"/>
            <rfilter type="box"/>
        </film>
        <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
    </sensor>
    <shape type="cube" id="box">
        <transform name="to_world"><scale value="2"/></transform>
        <bsdf type="null"/>
        <ref name="interior" id="fog"/>
    </shape>
    <shape type="rectangle" id="floor">
        <transform name="to_world"><rotate x="1" angle="-90"/><translate y="-1"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
    </shape>
    <shape type="sphere" id="ball">
        <point name="center" x="0.5" y="0" z="0"/>
        <float name="radius" value="0.4"/>
        <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.9, 0.4"/></bsdf></bsdf>
    </shape>
    <emitter type="spot" id="spot">
        <transform name="to_world"><lookat origin="0, 3, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
        <rgb name="intensity" value="10"/>
        <float name="cutoff_angle" value="30"/>
        <float name="beam_width" value="20"/>
    </emitter>
    <emitter type="constant"><rgb name="radiance" value="0.1"/></emitter>
</scene>"""
SEEDS = {"some": range(40), "more": range(40, 100)}
RENDERED = 2  # the first of them
VALUES = [
    "nan", "inf", "-1", "0", "1e38", "1e-38", "-1, 0, 1", "text", "", "true", "1000000000", "0, 0, 0", "0.1 0.2",
    "#ff00ff", "2", "-30", "361", "$gone",
]  # fmt: skip
TYPES = [
    "gone", "sphere", "cube", "diffuse", "null", "point", "dielectric", "area", "hg", "rgb", "homogeneous",
    "orthographic", "box", "gaussian",
]  # fmt: skip


def mutate(root: ElementTree.Element, chance: random.Random) -> str:
    """Change a scene in one place, and return what was changed."""
    parents = {child: parent for parent in root.iter() for child in parent}
    # A scene without its film has 768 x 576 pixels, which are slow.
    found = [each for each in parents if each.tag not in ("film", "sampler") and parents[each].tag != "film"]
    element = chance.choice(found)
    what = f"{element.tag} {element.attrib}"
    action = chance.random()
    if action < 0.15:
        parents[element].remove(element)
        return f"{what} is gone"
    if action < 0.25:
        parents[element].append(element)
        return f"{what} is there twice"
    name = chance.choice(sorted(element.attrib))
    element.set(name, chance.choice(TYPES if name in ("type", "id", "name") else VALUES))
    return f"{what}: {name} is {element.get(name)!r}"


@pytest.mark.parametrize("seeds", sweep(SEEDS, ["some"]))
def test_a_scene_that_is_wrong_in_one_place_is_built_or_refused(seeds, tmp_path, caplog):
    caplog.set_level(logging.WARNING, "photonbeams")
    built = 0
    for seed in SEEDS[seeds]:
        root = ElementTree.fromstring(SCENE)
        what = mutate(root, random.Random(seed))
        path = tmp_path / f"{seed}.xml"
        path.write_bytes(ElementTree.tostring(root))
        try:
            shot = pb.Shot.open(path)
            begin(shot.subject.load(), shot.subject.sensor(shot.viewpoint)[1], shot.settings())
            if built < RENDERED:
                assert np.isfinite(shot.render(passes=1).layers["rgba"]).all(), (seed, what)
            built += 1
        except SceneError as error:
            assert len(str(error)) <= LONGEST, (seed, what)
            assert "\n" not in str(error), (seed, what)
        except Exception as error:
            raise AssertionError((seed, what)) from error
    assert all(len(record.getMessage()) <= LONGEST for record in caplog.records)
    assert built > len(SEEDS[seeds]) // 3  # otherwise the test checks little
