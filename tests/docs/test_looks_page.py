"""docs/looks.md agrees with the schema, and its examples work."""

import re
from pathlib import Path

import numpy as np
import pytest

from photonbeams.looks.vocabulary import FUNCTIONS, NAMES
from photonbeams.usd import stage as stages
from photonbeams.usd.looks.look import LookSpec

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "looks.md").read_text()
SCHEMA = (ROOT / "src/photonbeams/usd/schema/schema.usda").read_text().split('class PhotonBeamsLook "')[1]


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("source", blocks("python"))
def test_python_on_the_page_runs(source):
    names = {}
    exec(source, names)
    assert np.all(np.isfinite(names["radiance"].numpy())) if "radiance" in names else names["look"]


def test_the_stages_on_the_page_are_read(tmp_path):
    found = []
    for number, text in enumerate(blocks("usda")):
        path = tmp_path / f"{number}.usda"
        path.write_text(text)
        stage = stages.open_stage(path)
        found.append(stages.read_scene(stage, stages.default_time(stage)).lights)
    (light,), pools = found
    assert [each.look.values["surfaces"] for each in pools] == ["off", "tint"]
    assert isinstance(light.look, LookSpec)
    assert light.look.values["along:ramp:knots"] == pytest.approx((0, 0.4, 1))
    assert light.look.values["across:hardness"] == pytest.approx(0.3)


def test_the_page_names_all_attributes_and_no_others():
    defined = set(re.findall(r"photonbeams:((?:along|across|eye|angle|noise):[\w:]+)", SCHEMA))
    named = set(re.findall(r"\b((?:along|across|eye|angle|noise):[\w:]+)", PAGE))
    assert named == defined


def test_the_page_tells_all_inputs_and_functions_of_expressions():
    for name, each in NAMES.items():
        vector = " (a vector)" if each.kind == "vector" else ""
        assert f"| `{name}` | {each.doc}{vector} |" in PAGE
    for each in FUNCTIONS.values():
        assert f"| `{each.signature}` | {each.doc} |" in PAGE
    assert len(re.findall(r"^\| `[\w]+(?:\(.*\))?` \| (?!.* \| )", PAGE, re.MULTILINE)) == len(NAMES) + len(FUNCTIONS)


def test_the_page_names_all_tokens():
    tokens = {
        token for row in re.findall(r"allowedTokens = \[(.*?)\]", SCHEMA) for token in re.findall(r'"(\w+)"', row)
    }
    assert [token for token in tokens if f'"{token}"' not in PAGE] == []


def test_every_picture_is_there_and_small():
    shown = set(re.findall(r"\((pictures/[^)]+)\)", PAGE + (ROOT / "docs" / "theory.md").read_text()))
    assert len(shown) >= 25
    assert [name for name in shown if not (ROOT / "docs" / name).is_file()] == []
    assert sum((ROOT / "docs" / name).stat().st_size for name in shown) < 2_000_000
