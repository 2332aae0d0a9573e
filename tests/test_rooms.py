"""The imports between the packages ("rooms") of the program, and between tests, read from their modules."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import photonbeams

SOURCE = Path(photonbeams.__file__).parent
TESTS = Path(__file__).parent

#: Each package may import those before it, and none after it.
ROOMS = (
    "constants", "scene", "setting", "runtime", "volumes", "numerics", "quadrature", "beams", "looks", "estimators",
    "studies", "world", "transport", "render", "images", "usd", "shot", "export", "integrator", "farm", "studio",
    "blender", "cli",
)  # fmt: skip

#: Wings of a package, and modules beside them. Each may import those before it; modules that are not listed, all.
WINGS = {
    "render": ("films", "techniques", "settings", "passes", "costs", "memory", "paths"),
    "transport": ("segments",),
    "usd": ("common", "layers", "materials", "geometry", "media", "looks", "lights", "cameras", "authoring"),
    "world": (
        "spectra", "warp", "differentials", "checks", "parameters", "shutter", "bounds", "shadow_rays", "surfaces",
        "emission", "media", "emitters", "cameras",
    ),
}  # fmt: skip

#: The most modules of a folder.
MOST_MODULES = 20

#: The packages that may import a library, or ask `runtime` for Mitsuba.
KNOWERS = {
    "dask": {"farm"},
    "distributed": {"farm"},
    "pxr": {"usd", "cli", "blender"},  # `info` reads stages itself, and `doctor` versions; Blender exports by its own
    "OpenEXR": {"images"},
    "OpenImageIO": {"images"},
    "anywidget": {"studio"},
    "blosc": {"volumes"},
    "mitsuba": {"runtime", "world", "transport", "render", "shot", "export", "integrator"},
    "mitsuba_oidn": {"render"},
    "drjit": {*ROOMS} - {"constants", "scene", "setting", "volumes", "quadrature", "usd", "farm", "cli"},
}

MODULES = sorted(path for path in SOURCE.rglob("*.py") if path.parent != SOURCE or path.stem in ROOMS)


def room_of(path: Path) -> str:
    return path.relative_to(SOURCE).with_suffix("").parts[0]


@cache
def imports(path: Path) -> list[str]:
    """Return the dotted names of all that a module imports at run time, without imports for type checkers only."""
    found: list[str] = []
    package = path.relative_to(SOURCE).parent.parts

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            found.extend(each.name for each in node.names)
        if isinstance(node, ast.ImportFrom):
            base = ("photonbeams", *package[: len(package) - node.level + 1]) if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            found.extend(f"{module}.{each.name}" for each in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_room_knows_those_before_it_alone(path):
    own = ROOMS.index(room_of(path))
    known = {name.split(".")[1] for name in imports(path) if name.startswith("photonbeams.")}
    below = {each for each in known if each in ROOMS and ROOMS.index(each) > own}
    assert not below, f"{path.name} knows {', '.join(sorted(below))}"


def wing_of(room: str, parts: tuple[str, ...]) -> int:
    """Return the index of the wing that a module is in; behind all wings for modules of the package itself."""
    wings = WINGS[room]
    return wings.index(parts[0]) if parts and parts[0] in wings else len(wings)


@pytest.mark.parametrize("room", WINGS)
def test_a_wing_knows_those_before_it_alone(room):
    for path in (each for each in MODULES if room_of(each) == room):
        own = wing_of(room, path.relative_to(SOURCE / room).with_suffix("").parts)
        for name in imports(path):
            parts = tuple(name.split(".")[1:])
            if name.startswith("photonbeams.") and parts[0] == room and parts[1:]:
                assert wing_of(room, parts[1:]) <= own, f"{path.relative_to(SOURCE)} knows {name}"


@pytest.mark.parametrize("folder", sorted({path.parent for path in MODULES}), ids=lambda path: path.name)
def test_a_folder_has_few_modules(folder):
    modules = [each for each in folder.glob("*.py") if each.stem != "__init__"]
    assert len(modules) <= MOST_MODULES


@pytest.mark.parametrize("library", KNOWERS)
def test_a_library_is_known_where_it_belongs_alone(library):
    for path in MODULES:
        names = imports(path)
        known = any(name.split(".")[0] == library for name in names)
        known |= library == "mitsuba" and "photonbeams.runtime.device.mitsuba" in names
        assert not known or room_of(path) in KNOWERS[library], f"{path.relative_to(SOURCE)} knows {library}"


def test_the_packages_of_the_architecture_page_are_the_rooms():
    page = (SOURCE.parents[1] / "docs" / "architecture.md").read_text()
    table = page.split("| package |")[1].split("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == list(ROOMS)


@pytest.mark.parametrize("path", sorted(TESTS.rglob("*.py")), ids=lambda path: str(path.relative_to(TESTS)))
def test_no_test_module_is_imported_and_helpers_stay_in_their_room(path):
    room = path.relative_to(TESTS).parts[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            base = "tests." + room if node.level else node.module
            names = [f"{base}.{each.name}" for each in node.names]
        for parts in (name.split(".") for name in names if name.startswith("tests.")):
            assert not any(part.startswith("test_") for part in parts), f"{path.name} imports {'.'.join(parts)}"
            assert parts[1] in ("helpers", room), f"{path.name} imports {'.'.join(parts)}: move it to tests/helpers"


def test_the_folders_of_the_tests_are_the_rooms_and_what_else_is_tested():
    folders = {each.relative_to(TESTS) for each in TESTS.rglob("*") if each.is_dir() and any(each.glob("test_*.py"))}
    others = {"benchmarks", "docs", "examples", "matrix", "tools"}
    for path in sorted(folders):
        assert (SOURCE / path).is_dir() or str(path) in {".", *others}, f"there is no {path} in src/, but in tests/"


def test_the_quick_tests_are_there_and_of_every_room():
    quick = (TESTS / "quick.txt").read_text().split()
    assert quick == sorted(quick)
    for path, _, name in (each.partition("::") for each in quick):
        file = TESTS.parent / path
        assert file.exists(), path
        assert not name or f"def {name}(" in file.read_text(encoding="utf-8"), f"{path} has no {name}"
    rooms = {each.name for each in TESTS.iterdir() if any(each.glob("**/test_*.py"))}
    assert rooms - {each.split("/")[1] for each in quick} <= {"benchmarks", "examples", "matrix"}  # minutes each
