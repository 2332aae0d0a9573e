"""The budget: what it counts in small packages, and which changes it refuses."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from tools import budget

CODE = "def area(width, height):\n    return 2 * width * height\n"
COMMENTED = '''"""Areas."""

# Of rectangles.


def area(width, height):
    """Return the area,

    twice.
    """

    # Width times height.
    return 2 * width * height  # twice
'''
PLACE = "src/photonbeams/room/module.py"


@dataclass
class Repository:
    """A repository with one package."""

    root: Path

    def write(self, path: str, text: str) -> None:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    def module(self, text: str, path: str = "room/module.py") -> None:
        self.write(f"src/photonbeams/{path}", text)

    def counted(self, name: str) -> int:
        return budget.counted(budget.read(self.root))[name]

    def call(self, *arguments: str) -> int:
        return budget.main(arguments, self.root)

    def numbers(self) -> dict[str, int]:
        return budget.loaded(self.root / budget.FILE)

    def set(self, **numbers: int) -> None:
        """Write the file with other numbers of the room, or of the whole."""
        changed = {f"{'room' if kind in ('tokens', 'modules') else 'whole'}.{kind}": numbers[kind] for kind in numbers}
        budget.write(self.root / budget.FILE, self.numbers() | changed)


@pytest.fixture
def repository(tmp_path):
    (tmp_path / "tools").mkdir()
    return Repository(tmp_path)


def test_tokens_are_names_numbers_strings_and_operators(repository):
    repository.module("length = 2 * width + len('four')\n")
    assert repository.counted("room.tokens") == 10


@pytest.mark.parametrize("text", [CODE, COMMENTED], ids=["code", "commented"])
def test_docstrings_comments_and_blank_lines_do_not_count(repository, text):
    repository.module(text)
    assert repository.counted("room.tokens") == 14


def test_an_f_string_is_one_token(repository):
    repository.module("""text = f"{width:{places}d} by {f'{height}'}"\n""")
    assert repository.counted("room.tokens") == 3


def test_rooms_are_packages_and_modules_and_the_extension_is_its_own(repository):
    for path in ("__init__.py", "beams/a.py", "beams/deep/b.py", "blender/worker.py", "blender/extension/look/c.py"):
        repository.module("x = 1\n", path)
    numbers = budget.counted(budget.read(repository.root))
    modules = {name.removesuffix(".modules"): number for name, number in numbers.items() if name.endswith(".modules")}
    assert modules == {"__init__": 1, "beams": 2, "blender": 1, "blender-extension": 1}
    assert numbers["blender-extension.tokens"] == 3


def test_public_names_are_functions_and_classes_at_the_top_level(repository):
    repository.module(
        "LIMIT = 2\ndef area(): ...\nasync def wait(): ...\nclass Beam:\n    def end(self): ...\n"
        "def _hidden():\n    def inner(): ...\nclass _Secret: ...\n"
    )
    repository.module("def operator(): ...\n", "blender/extension/looks.py")
    assert repository.counted("whole.names") == 3


def test_a_class_name_with_an_underscore_is_the_same_name(repository):
    repository.module("class Rays: ...\nclass Beam: ...\n")
    repository.module("class _Rays: ...\nclass Beams: ...\n", "other/module.py")
    assert repository.counted("whole.classes") == 1


@pytest.mark.parametrize(
    ("call", "number"),
    [
        ("beam(a, b, c, d)", 0),
        ("beam(a, b, c, d, e)", 1),
        ("beam(*a, *b, *c, *d)", 0),
        ("beam(a, b, c, d, *e)", 1),
        ("beam(a, b, c, d, e=e, **f)", 0),
    ],
)
def test_calls_with_five_positional_arguments_count(repository, call, number):
    repository.module(f"{call}\n")
    assert repository.counted("whole.calls") == number


@pytest.mark.parametrize(
    ("result", "number"),
    [
        ("tuple[A, B]", 0),
        ("tuple[A, ...]", 0),
        ("list[A]", 0),
        ("dict[A, tuple[A, B]]", 0),
        ("tuple[A, B, C]", 1),
        ("tuple[A, tuple[B, C], D] | None", 1),
    ],
)
def test_results_that_are_tuples_of_three_count(repository, result, number):
    repository.module(f"def ends(triple: tuple[A, B, C]) -> {result}: ...\n")
    assert repository.counted("whole.tuples") == number


TYPES = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .a import A\n"


@pytest.mark.parametrize(
    "back",
    [
        "from .a import A\n",
        "from . import a\n",
        "import photonbeams.room.a\n",
        "from photonbeams.room import a\n",
        "def late():\n    from .a import A\n",
        TYPES,
    ],
    ids=["name", "module", "import", "absolute", "function", "type"],
)
def test_a_circle_is_one_however_its_imports_stand(repository, back):
    repository.module("from .b import B\n", "room/a.py")
    repository.module("from .c import C\n", "room/b.py")
    repository.module(back, "room/c.py")
    repository.module("from . import a, b, c\n", "room/d.py")
    assert repository.counted("whole.circles") == 1
    assert repository.counted("whole.circular-modules") == 3


def test_imports_of_other_libraries_and_of_what_comes_before_are_no_circle(repository):
    repository.module("import numpy as np\nfrom numpy import pi\n", "room/a.py")
    repository.module("from . import a\nfrom .a import pi\n", "room/b.py")
    assert repository.counted("whole.circles") == 0
    assert repository.counted("whole.circular-modules") == 0


def test_the_name_that_a_package_offers_is_imported_from_the_package(repository):
    repository.module("from .a import A\n", "room/__init__.py")
    repository.module("from photonbeams.room import B\n", "room/a.py")
    assert repository.counted("whole.circular-modules") == 2


def test_the_first_file_is_written_and_asked_for(repository, capsys):
    repository.module(CODE)
    assert repository.call() == 1
    assert "--write" in capsys.readouterr().out
    assert repository.call("--write") == 0
    assert repository.numbers()["room.tokens"] == 14
    assert repository.call() == 0


def test_the_file_has_one_number_a_line_sorted_by_room(repository):
    repository.module(CODE, "b/module.py")
    repository.module(CODE, "a.py")
    repository.call("--write")
    text = (repository.root / budget.FILE).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert lines[:4] == ["a.modules = 1", "a.tokens = 14", "b.modules = 1", "b.tokens = 14"]
    assert len(lines) == len(repository.numbers())


def test_a_number_that_rises_fails_and_is_named(repository, capsys):
    repository.module(CODE)
    repository.call("--write")
    repository.set(tokens=12)
    capsys.readouterr()
    assert repository.call() == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("room.tokens was 12, and is 14: lower it, or raise it in tools/budget.toml")
    assert len(lines) == 2


def test_a_new_room_fails_with_the_lines_to_add(repository, capsys):
    repository.module(CODE)
    repository.call("--write")
    repository.module(CODE, "other.py")
    assert repository.call() == 1
    printed = capsys.readouterr().out
    assert "add `other.modules = 1`" in printed
    assert "add `other.tokens = 14`" in printed


def test_numbers_that_fall_are_told_and_do_not_fail(repository, capsys):
    repository.module(CODE)
    repository.call("--write")
    repository.set(tokens=20)
    before = repository.numbers()
    assert repository.call() == 0
    assert "room.tokens was 20, and is 14" in capsys.readouterr().out
    assert repository.numbers() == before


def test_writing_lowers_numbers_and_raises_none(repository):
    repository.module(CODE)
    repository.call("--write")
    repository.set(tokens=12, names=7)
    repository.module(CODE, "other.py")
    assert repository.call("--write") == 1
    numbers = repository.numbers()
    assert numbers["room.tokens"] == 12
    assert numbers["whole.names"] == 2
    assert "other.tokens" not in numbers


def test_writing_removes_a_room_that_is_not_there_any_more(repository, capsys):
    repository.module(CODE)
    repository.module(CODE, "other.py")
    repository.call("--write")
    (repository.root / "src/photonbeams/other.py").unlink()
    assert repository.call() == 0
    assert "other.tokens was 14, and is 0" in capsys.readouterr().out
    repository.call("--write")
    assert {name.split(".")[0] for name in repository.numbers()} == {"room", "whole"}


@pytest.mark.parametrize(
    ("kind", "text", "line"),
    [
        ("calls", "\nbeam(a, b, c, d, e)\n", f"{PLACE}:2: beam() has 5 positional arguments"),
        ("classes", "class Rays: ...\nclass _Rays: ...\n", f"{PLACE}:2: class _Rays"),
        ("names", "\n\ndef area(): ...\n", f"{PLACE}:3: area"),
        ("tokens", CODE, f"{PLACE}:1: 14 tokens"),
        ("tuples", "def ends() -> tuple[A, B, C]: ...\n", f"{PLACE}:1: ends() returns tuple[A, B, C]"),
        ("circles", "\nfrom . import other\n", f"{PLACE}:2: circle 1 of 2 modules: imports photonbeams.room.other"),
    ],
)
def test_the_places_of_what_counts_are_listed(repository, capsys, kind, text, line):
    repository.module(text)
    repository.module("from .module import area\n", "room/other.py")
    assert repository.call("--list", kind) == 0
    assert line in capsys.readouterr().out.splitlines()
