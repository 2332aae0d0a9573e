"""What the tests of the studio share."""

import pytest

from tests.studio.sessions import STAGE


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    return path
