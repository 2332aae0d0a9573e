"""Settings: the values that they accept, and the error messages for others."""

import subprocess
import sys

import numpy as np
import pytest

from photonbeams.constants import FILTERS
from photonbeams.render import settings
from photonbeams.render.settings import Settings, SettingsArguments
from photonbeams.scene import SceneError


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"passes": 0}, "passes is 0: expected 1 to 2147483647"),
        ({"passes": "4"}, "passes is '4': expected a whole number"),
        ({"seed": "1"}, "seed is '1': expected a whole number"),
        ({"time_limit": 0}, "time_limit is 0: expected a positive number of seconds"),
        ({"time_limit": np.inf}, "time_limit is inf: expected a positive number of seconds"),
        ({"beams": 0}, "beams is 0: expected 1 to 100000000"),
        ({"beams": 10**9}, "beams is 1000000000: expected 1 to 100000000"),
        ({"max_depth": -2}, "max_depth is -2: expected -1 (any) or 0 to 2147483647"),
        ({"max_depth": 2.0}, "max_depth is 2.0: expected a whole number"),
        ({"rr_depth": 0}, "rr_depth is 0: expected 1 to 2147483647"),
        ({"hide_emitters": 1}, "hide_emitters is 1: expected True or False"),
        ({"guiding": "yes"}, "guiding is 'yes': expected True or False"),
        ({"radius": 0.0}, "radius is 0.0: expected a number above 0"),
        ({"max_radius": "1"}, "max_radius is '1': expected a number above 0"),
        ({"min_radius": 0.2, "max_radius": 0.1}, "min_radius is 0.2: expected at most 0.1 (max_radius)"),
        ({"overlap": np.nan}, "overlap is nan: expected a finite number above 0"),
        ({"alpha": 0}, "alpha is 0: expected a number above 0 and at most 1"),
        ({"alpha": "a"}, "alpha is 'a': expected a number above 0 and at most 1"),
        ({"estimator": "best"}, "estimator is 'best': expected one of auto, billboard, frustum"),
        ({"rule": 6}, "rule is 6: expected a Rule, such as gauss_legendre(6)"),
        ({"pixel_filter": "sinc"}, "pixel_filter is 'sinc': expected one of " + ", ".join(FILTERS)),
        ({"program": len}, "program is <built-in function len>: expected a Program"),
    ],
)
def test_what_is_out_of_range_is_told_by_its_name(given, sentence):
    with pytest.raises(SceneError) as error:
        Settings(**given)
    assert str(error.value) == sentence


def test_numbers_of_numpy_become_plain_ones():
    made = Settings(passes=np.int64(3), beams=np.uint16(16), seed=np.int32(-1), overlap=np.float32(2))
    assert (repr(made.passes), repr(made.beams), repr(made.seed), repr(made.overlap)) == ("3", "16", "-1", "2.0")


def test_what_is_given_is_over_what_there_is():
    own = Settings(passes=3, seed=5)
    assert Settings.of(own, {"seed": 6}) == Settings(passes=3, seed=6)
    assert Settings.of(None, {}) == Settings()
    with pytest.raises(SceneError, match="zzz is not a setting"):
        Settings.of(own, {"zzz": 1})


def test_a_depth_is_the_scenes_own_or_any():
    assert Settings().depth() is None and Settings().depth(2) == 2
    assert Settings(max_depth=-1).depth(2) is None and Settings(max_depth=7).depth(2) == 7


def test_everything_but_passes_may_be_given_by_name():
    own = {name: kind for name, kind in Settings.__annotations__.items() if name != "passes"}
    assert {name: kind.__forward_arg__ for name, kind in SettingsArguments.__annotations__.items()} == own


def test_settings_are_described_without_heavy_libraries():
    script = "import sys, photonbeams.render.settings as s; list(s.flags()); list(s.parameters()); "
    script += "print({'numpy', 'drjit', 'mitsuba'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "set()\n"


@pytest.mark.parametrize("named", [*settings.described(), *settings.parameters()], ids=lambda each: each[0])
def test_what_sets_a_setting_takes_its_default(named):
    name, own = named
    assert own.default is None or own.kind is object or own.checked(own.default, name) == own.default
