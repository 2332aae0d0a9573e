"""Subjects of commits: `area: what changes`, of at most 72 characters."""

import pytest

from tools.commits import LONGEST, mistake


@pytest.mark.parametrize(
    "subject",
    ["usd: one file cannot be read", "usd, world: links", "render/film: sums", "tests: " + "x" * (LONGEST - 7),
     "Merge branch 'main'", 'Revert "usd: one file"'],
)  # fmt: skip
def test_subjects_with_an_area_are_accepted(subject):
    assert not mistake(subject)


@pytest.mark.parametrize("subject", ["", "Fix", "Usd: one file", "usd one file", "usd:one", "usd: " + "x" * LONGEST])
def test_subjects_that_are_long_or_have_no_area_are_refused(subject):
    assert mistake(subject)
