"""docs/architecture.md names packages, modules and classes that exist."""

import re
from functools import reduce
from importlib import import_module
from string import ascii_lowercase

from docs.scripts.pages import ROOT

PAGE = (ROOT / "docs/architecture.md").read_text()
SOURCE = ROOT / "src/photonbeams"


def test_every_step_of_the_walk_is_defined_in_its_module():
    steps = re.findall(r"^\| (\w+) \| `([\w/]+)\.py` \| (.+?) \|", PAGE, re.MULTILINE)
    numbers, letters = ([each for each, *_ in steps if each.isdigit() is digits] for digits in (True, False))
    assert numbers == [str(number) for number in range(1, len(numbers) + 1)]
    assert letters == [*ascii_lowercase[: len(letters)]] and len(numbers) > len(letters) > 5
    for _, path, cell in steps:
        module = import_module(f"photonbeams.{path.replace('/', '.')}")
        for name in re.findall(r"`([\w.]+)`", cell):
            found = reduce(getattr, name.split("."), module)
            assert found.__module__ == module.__name__, f"{path}: {name}"


def test_every_file_is_there_and_every_class_is_defined_somewhere():
    for path in re.findall(r"`((?:\w+/)*\w+\.py|\w+/(?:schema|estimators)/)`", PAGE):
        assert (SOURCE / path).exists() or (ROOT / path).exists(), path
    code = "\n".join(path.read_text() for path in SOURCE.rglob("*.py"))
    for name in re.findall(r"`(?:looks\.|scene\.)?([A-Z]\w+)(?:\.\w+)*`", PAGE):
        assert re.search(rf"^class {name}\b", code, re.MULTILINE), name
