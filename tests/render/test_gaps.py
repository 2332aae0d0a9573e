"""A render says which gaps are finer than its beams, and the number of beams that it names resolves them."""

import re

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba
from tests.helpers.blind import Blind, contrast

WORDS = r"gaps (?:of|near) (.+) are (\S+) units wide, but beams of (\S+) (\S+) there, .*: expected --beams (\d+)$"
# A picture shows stripes if they have nine tenths of the contrast that 32 times as many beams give. The number that is
# named has 0.908 to 0.928 for five random blinds, half of it 0.843 to 0.876.
RESOLVED = 0.9


def said(caplog, shot, **settings):
    """Return what is said of gaps as a shot is rendered, and its beams."""
    caplog.clear()
    beams = shot.render(width=128, surfaces=False, **settings).layers["beams"]
    return [each for each in caplog.messages if " units wide, but beams of " in each], beams


def opened(tmp_path, blind):
    path = tmp_path / "blind.usda"
    path.write_text(blind.stage())
    return pb.Shot.open(path)


@pytest.mark.parametrize(("seed", "meters"), [pytest.param(0, 1.0, marks=pytest.mark.soak), (1, 0.01)])
def test_the_number_that_is_named_resolves_a_blind_and_half_of_it_does_not(tmp_path, caplog, seed, meters):
    random = np.random.default_rng(seed)
    away = random.uniform(1, 4) / meters
    place, turned = tuple(random.uniform(-5, 5, 3) / meters), tuple(random.uniform(-180, 180, 3))
    blind = Blind(random.uniform(0.03, 0.06) * away, away, place, meters=meters, turned=turned)
    shot = opened(tmp_path, blind)
    (sentence,), _ = said(caplog, shot, passes=2, beams=128)
    assert len(sentence) <= 300
    surface, size, lamp, wide, number = re.search(WORDS, sentence).groups()
    assert (surface, lamp) == ("/Room/Blind", "/Room/Lamp")
    # Rings are 2^(1/2) apart, but elsewhere for each beam, of which the median counts; directions are 22.5 degrees
    # apart at most from that across the gap.
    assert 2 ** (-1 / 8) < float(size) / blind.gap < 2 ** (1 / 8) / np.cos(np.pi / 8)
    assert float(wide) > float(size)
    (_, fine), both = said(caplog, shot, passes=2, beams=32 * int(number)), []
    for count in (int(number), int(number) // 2):
        again = opened(tmp_path, blind)  # a shot says it once
        told, pictures = zip(*(said(caplog, again, passes=2, beams=count, seed=each) for each in range(3)), strict=True)
        assert not told[0] or count < int(number)
        both.append(contrast(np.mean(pictures, axis=0), fine))
    assert both[0] > RESOLVED > both[1]


@pytest.mark.parametrize(
    ("blind", "count"),
    [
        (Blind(0.5, 1.0, (3.0, 1.0, -2.0), count=1), 512),  # a wide window
        (Blind(0.04, 1.0, (3.0, 1.0, -2.0)), 8192),  # beams that are fine enough
        (Blind(0.04, 1.0, (3.0, 1.0, -2.0), radius=0.3), 128),  # a lamp so wide that there are no stripes
    ],
)  # fmt: skip
def test_nothing_is_said_where_no_stripes_blur(tmp_path, caplog, blind, count):
    assert said(caplog, opened(tmp_path, blind), passes=1, beams=count)[0] == []


def test_a_lamp_with_its_own_number_is_told_what_to_set_and_a_strict_shot_renders(tmp_path, caplog):
    path = tmp_path / "blind.usda"
    text = Blind(0.04, 1.0, (0.0, 0.0, 0.0)).stage()
    path.write_text(text.replace("float inputs:radius", "int photonbeams:count = 128\n        float inputs:radius"))
    pb.Shot.open(path, strict=True).render(passes=1, width=128, surfaces=False)
    assert re.search(r"expected --set /Room/Lamp\.photonbeams:count=\d+$", caplog.text.strip())


def test_a_mitsuba_scene_is_told_where_its_gaps_are(caplog):
    mi = mitsuba()
    to = mi.ScalarTransform4f
    slats = {
        f"slat{each}": {
            "type": "rectangle", "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}},
            "to_world": to().translate([0.08 * (each - 3), 0, 0]).scale([0.02, 2, 1]),
        }
        for each in range(7)
    }  # fmt: skip
    fog = {"type": "homogeneous", "sigma_t": 0.1, "albedo": 1.0}
    shot = pb.Shot({
        "type": "scene", "lamp": {"type": "point", "id": "lamp", "position": [0, 0, 1], "intensity": 10.0},
        "air": {"type": "cube", "bsdf": {"type": "null"}, "interior": fog, "to_world": to().scale(3)}, **slats,
        "sensor": {"type": "perspective", "fov": 30, "film": {"type": "hdrfilm", "width": 128, "height": 32},
                   "to_world": to().look_at(origin=[0, 2, -1], target=[0, 0, -1], up=[0, 0, 1]), "medium": fog},
    })  # fmt: skip
    (sentence,), _ = said(caplog, shot, passes=1, beams=256, method="beams")
    # Mitsuba joins the slats to one mesh without an id.
    place, size, lamp, _, number = re.search(WORDS, sentence).groups()
    x, y, z = map(float, place.split())
    assert abs(z) < 1e-3 and abs(y) < 2 and abs((x - 0.04) / 0.08 - round((x - 0.04) / 0.08)) < 0.25 and lamp == "lamp"
    assert abs(float(size) / 0.04 - 1) < 0.2 and int(number) > 256
