"""Every feature: a stage and its Mitsuba twin make the picture that `volpath` makes of the twin."""

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.agreement import deviations, means, ratio
from tests.helpers.sweep import sweep
from tests.matrix.page import FILE, page
from tests.matrix.references import opened, reference, twin
from tests.matrix.rows import BIAS, BLOCK_BIAS, HEIGHT, MATRIX, WIDTH, mi

SEEDS = 3
ROWS = {row.name: row for row in MATRIX}
#: Rows for `make test`. Between them: one and several scatterings, a phase function with a direction, coloured media
#: and one in another, a grid, shadows and a portal, and what glass reflects and refracts.
KEPT = (
    "single scattering, Henyey-Greenstein 0.8", "a hole with a portal", "nested media",
    "a glass ball with its caustic",
)  # fmt: skip


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    """Return a function that gives the means of a row's stage."""
    known = {}

    def found(name):
        if name not in known:
            row = ROWS[name]
            shot = opened(row, tmp_path_factory.mktemp("stage"))
            settings = {
                "passes": row.passes,
                "beams": row.beams,
                "width": WIDTH,
                "height": HEIGHT,
                **row.settings,
            }
            settings |= {"max_depth": row.max_depth} if row.bounces else {}
            frames = [shot.render(seed=seed, **settings) for seed in range(SEEDS)]
            known[name] = means(np.array([each.layers["rgba"][..., :3] for each in frames]))
        return known[name]

    return found


def rendered(row, folder):
    """Return the means of the Mitsuba scene of a row."""
    scene = twin(row, folder)
    integrator = mi.load_dict({"type": "photon_beams", "method": "beams", "max_depth": row.max_depth, **row.plugin})
    pictures = [mi.render(scene, integrator=integrator, spp=row.passes, seed=seed) for seed in range(SEEDS)]
    return means(np.array([np.array(each)[..., :3] for each in pictures]))


@pytest.fixture(scope="module")
def twins(tmp_path_factory):
    """Return a function that gives the means of a row's Mitsuba scene."""
    known = {}

    def found(name):
        if name not in known:
            known[name] = rendered(ROWS[name], tmp_path_factory.mktemp("twin"))
        return known[name]

    return found


def agree(ours, theirs):
    """Assert that two pictures agree.

    In addition to four standard errors, their means may differ by the bias of wide beams at the boundary of the fog;
    blocks may differ by three times as much. None of 120 numbers, with variances from three seeds, should be six
    standard errors off.
    """
    value, error = ratio(ours, theirs)
    assert abs(value - 1) < BIAS + 4 * error, (value, error)
    assert error < 3 * BIAS, "too noisy to tell"  # of two pictures with few seeds
    assert deviations(ours, theirs, BLOCK_BIAS).max() < 6


@pytest.mark.parametrize("name", sweep(ROWS, KEPT))
def test_a_stage_is_the_picture_of_volpath(name, stages):
    agree(stages(name), reference(ROWS[name]))


@pytest.mark.parametrize("name", sweep(ROWS, KEPT))
def test_a_mitsuba_scene_is_the_picture_of_volpath(name, twins):
    agree(twins(name), reference(ROWS[name]))


@pytest.mark.parametrize("name", sweep(ROWS, KEPT))
def test_both_doors_make_one_picture(name, stages, twins):
    agree(stages(name), twins(name))


@pytest.mark.parametrize("name", sweep(["nested media", "a grid"], ["nested media"]))
def test_an_export_is_the_scene_that_one_writes_by_hand(name, twins, tmp_path):
    agree(rendered(replace(ROWS[name], twin=None), tmp_path), twins(name))


@pytest.mark.soak  # in `make test`, the light through the portal is that of `volpath` through the hole
def test_a_portal_does_not_change_the_light(stages):
    agree(stages("a hole with a portal"), stages("a hole without a portal"))


def test_the_page_of_the_matrix_is_up_to_date():
    assert FILE.read_text(encoding="utf-8") == page(), "run python -m tests.matrix.page"
