"""All that README.md and docs/ tell a reader to type works: commands, Python, files to save, messages, links.

Every `sh` block is run, page by page, in a folder with the examples, as in a reader's clone. Flags at the end make
renders small, since the last one wins. Renders that only repeat what an earlier command has shown end before their
first pass: --dry-run still reads and checks the scene and every flag. tests/examples checks that each example renders,
and tests/cli that each flag does what it says: what is new in flags alone is rendered by `make soak`.
"""

import gc
import re
import runpy
import shutil
import tomllib
from dataclasses import replace
from fnmatch import fnmatch
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from docs.scripts.pages import ROOT, anchors, blocks, commands, links, saved_files
from photonbeams import Shot, integrator
from photonbeams.cli import main
from tests.helpers.sweep import sweep

PAGES = {
    "README.md": 5, "docs/guide.md": 20, "docs/stages.md": 13, "docs/beams.md": 6, "docs/examples.md": 19,
    "docs/looks.md": 1, "docs/blender.md": 0,
    "docs/mitsuba.md": 5, "docs/matrix.md": 0, "docs/theory.md": 0, "docs/dependencies.md": 0,
    "docs/architecture.md": 0, "docs/farm.md": 6, "docs/scale.md": 0, "docs/studio.md": 0, "docs/install.md": 1,
    "docs/performance.md": 4, "docs/glossary.md": 0, "docs/usdlux.md": 0, "docs/filters.md": 1,
    "docs/compositing.md": 4, "docs/color.md": 2,
}  # fmt: skip
#: Pages that only the site has, and Sphinx checks: tests/docs/test_site.py.
SITE = {"docs/index.md", "docs/gallery.md", "docs/changelog.md", "docs/contributing.md"}
#: Pages of commands that differ from others by the example that they render: tests/examples renders each of them.
MEASURED = {"docs/examples.md", "docs/performance.md"}
#: First words of commands that set up a machine or need another program.
SKIPPED = ("make", "apt", "apt-get", "pip", "blender", "git", "dask", "openssl", "pipx", "uvx")
CHEAP = {
    "render": ["--res", "64", "0", "--passes", "1", "--beams", "64", "--progress", "none"],
    "beams": ["--beams", "64"],
    "quadrature": ["--rays", "8", "--max-order", "6"],
}


def page(name):
    return (ROOT / name).read_text()


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """Return a folder with the examples, and with `shot.usda`, which pages name as any stage of the reader."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for path in (ROOT / "examples" / "keyhole").glob("*.png"):
        shutil.copy(path, tmp_path)
    shutil.copy(ROOT / "examples" / "keyhole" / "keyhole.usda", tmp_path / "shot.usda")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(arguments):
    """Return the exit code of the command, run in this process, because starting a new one takes most of the time."""
    with pytest.raises(SystemExit) as ending:
        main(arguments)
    code = ending.value.code or 0
    del ending
    gc.collect()  # the traceback holds the scene, and the next command would compile kernels for both
    return code


def is_skipped(words):
    """Return whether a command is not run here: another program, a farm (tests/cli) or a server (tests/studio)."""
    return words[0] in SKIPPED or words[1:2] == ["studio"] or bool({"--workers", "--scheduler"} & set(words))


def traits(words, flags=True):
    """Return what a render demonstrates: its flags, the kinds of its files, and its inputs except for examples."""
    files = {f"{flag} {Path(value).suffix}" for flag, value in pairwise(words) if flag in ("-o", "--picture")}
    read = {word.partition(":")[0] for word in words[2:]} - set(outputs(words))
    own = {file for file in read if not file.startswith("examples/") and Path(file).suffix in (".usda", ".usdc", ".py")}
    named = {word for word in words if word.startswith("-")} if flags else set()
    return named | files | own | {Path(words[2]).suffix}


@cache
def shown_before(flags):
    """Return the numbers, by page, of renders with no new traits, and with no files that a later command reads.

    Without `flags`, a flag that was not there before is no new trait.
    """
    known, found = set(), {}
    for name in PAGES:
        words = [each for each in commands(page(name)) if not is_skipped(each)]
        for number, each in enumerate(words):
            if each[1] != "render" or "--list-cameras" in each:
                continue
            read = {word for later in words[number + 1 :] for word in inputs(later)}
            needed = any(fnmatch(file, word) for file in outputs(each) for word in read)
            if traits(each, flags) <= known and not needed:
                found.setdefault(name, set()).add(number)
            known |= traits(each, flags)
    return found


def run(words, dry=False, bounces=False):
    """Run a documented command cheaply; assert that it succeeds, and return the files that it says it writes.

    Without `bounces`, light is scattered once: each bounce takes as long.
    """
    if is_skipped(words):
        return []
    assert words[0] == "photonbeams", f"{words[0]} is neither run nor among those that are skipped: {' '.join(words)}"
    plain = "".join(word for word in words if " " not in word)  # words with spaces were quoted, safe from the shell
    assert not set("|<>;&$*") & set(plain), f"only plain commands are run here: {' '.join(words)}"
    cheap = [] if "--list-cameras" in words else CHEAP.get(words[1], [])
    if cheap and not bounces and words[1] == "render" and (words[2].endswith(".xml") or "--bounces" in words):
        cheap = [*cheap, "--bounces", "0"]
    if "--pass-range" in words:
        cheap = [*cheap, "--passes", "2"]
    cheap = [*cheap, *first_and_last(words), *(["--dry-run"] if dry else [])]
    assert call([*words[1:], *cheap]) == 0, " ".join(words)
    return [] if dry else written(words)


def first_and_last(words):
    """Return flags for the first and the last of the frames that a command names, if it names a range."""
    named = [value for flag, value in pairwise(words) if flag in ("-f", "--frames") and ":" in value]
    if not named:
        return []
    first, last = (int(number) for number in named[-1].partition("x")[0].split(":"))
    return ["--frames", f"{first}:{last}x{last - first}"]


def inputs(words):
    """Return the words of a command that may name files that it reads."""
    return {word.rpartition("=")[2] for word in words[2:]} - set(outputs(words))


def outputs(words):
    """Return the names of the files that a command's flags name."""
    named = [value for flag, value in pairwise(words) if flag in ("-o", "--output", "--plot")]
    return named + [value.partition("=")[2] for flag, value in pairwise(words) if flag == "--picture"]


def written(words):
    """Return the names of the files that a command's flags name, as patterns with digits for #."""
    return [re.sub("#+", lambda run: "[0-9]" * len(run[0]), name) for name in outputs(words)]


def save_files(name, folder):
    """Write the files that a page tells its reader to save; beams.md and stages.md continue from the guide."""
    before = saved_files(page("docs/guide.md")) if name in ("docs/beams.md", "docs/stages.md") else {}
    for file, source in {**before, **saved_files(page(name))}.items():
        (folder / file).write_text(source)


@pytest.mark.parametrize("name", sweep(PAGES, PAGES.keys() - MEASURED))
def test_every_command_runs_and_writes_what_it_names(name, clone, pytestconfig):
    save_files(name, clone)
    soak = pytestconfig.getoption("--soak")
    shown = shown_before(flags=soak).get(name, ())
    asked = [words for words in commands(page(name)) if not is_skipped(words)]
    for number, words in enumerate(asked):
        for path in (path for pattern in written(words) for path in clone.glob(pattern)):
            path.unlink()  # an earlier command may have written it
        for pattern in run(words, dry=number in shown, bounces=soak):
            assert list(clone.glob(pattern)), f"{' '.join(words)} did not write {pattern}"
    assert len(asked) >= PAGES[name]


def test_every_page_is_among_them():
    assert {*PAGES} | SITE == {"README.md", *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))}


def test_every_fenced_block_is_of_a_language_that_is_tested():
    for name in PAGES:
        fences = re.findall(r"^```(.*)$", page(name), re.MULTILINE)
        assert set(fences[::2]) <= {"sh", "python", "usda"}, name
        assert set(fences[1::2]) <= {""}, name


@pytest.mark.parametrize(
    "command", ["photonbeams render nothing.usda -o a.png", "photonbeams render shot.usda --no-such-flag", "ls"]
)
def test_a_command_that_fails_is_found(command, clone):
    with pytest.raises(AssertionError):
        run(command.split())


def test_commands_are_words_without_comments_and_with_their_continued_lines():
    text = "```sh\nmake x   # a comment\nphotonbeams render \\\n    -o 'b c.png' --picture beams=d.####.png\n```\n"
    render = ["photonbeams", "render", "-o", "b c.png", "--picture", "beams=d.####.png"]
    assert commands(text) == [["make", "x"], render]
    assert written(render) == ["b c.png", "d.[0-9][0-9][0-9][0-9].png"]


@pytest.mark.parametrize("name", [name for name in PAGES if blocks(page(name), "python")])
def test_every_python_block_runs(name, clone, monkeypatch, pytestconfig):
    save_files(name, clone)
    render = Shot.render
    small = {"passes": 1, "width": 64, "beams": 64}
    monkeypatch.setattr(Shot, "render", lambda shot, *args, **settings: render(shot, *args, **{**settings, **small}))
    # Mitsuba's own `render` uses the number of paths in the scene's file, and its depth.
    given, few = integrator._settings, {"beams": 256}
    if not pytestconfig.getoption("--soak"):
        few["max_depth"] = 2
    monkeypatch.setattr(integrator, "_settings", lambda each: replace(given(each), **few))
    names = {}
    for index, source in enumerate(blocks(page(name), "python")):
        # Each block of a page continues from those before it, as for its reader, unless it begins with imports.
        if source.startswith("import photonbeams") or "\nimport photonbeams" in source:
            names = {}
            gc.collect()
        script = clone / f"block{index}.py"
        script.write_text(source)
        names = runpy.run_path(str(script), init_globals={k: v for k, v in names.items() if not k.startswith("__")})
        for file in re.findall(r'\.write\("([^"]+)"', source):
            assert (clone / file).is_file()


# -- messages --------------------------------------------------------------------------------------------------------

GOOD = ["render", "dusty.usda", "-o", "a.png", "--dry-run"]
STRICT = [*GOOD, "--strict"]
#: A change of the guide's layer and a command that provoke each of its messages.
PROVOKED = {
    "there is no fog": ((), ["render", "examples/blender/attic.usda", *STRICT[2:]]),
    "nothing makes beams": (
        (),
        [*STRICT, "--set", "/Attic/Spot/Spot.photonbeams:enabled=0", "--set", "/Attic/env_light.photonbeams:enabled=0"],
    ),
    "there is no camera": ((), [*STRICT, "--mask", "/Attic/Spot,/Attic/Barrel"]),
    "there is no light": ((), [*STRICT, "--mask", "/Attic/Camera,/Attic/Barrel"]),
    "has no camera": ((), [*GOOD, "--camera", "Nobody"]),
    "expected a prim that is on the stage": (("portal = </Skylight>", "portal = </Window>"), STRICT),
    "expected a PhotonBeamsLook": (("look = </Afternoon>", "look = </Fog>"), STRICT),
    "expected as many of each": (("knots = [0, 0.4, 1]", "knots = [0, 1]"), STRICT),
    "has no attribute": ((), [*GOOD, "--set", "/Fog.photonbeams:colour=1"]),
    "which is not there": (("attic.usda@", "cellar.usda@"), STRICT),
    "expected a name that ends in .exr": ((), ["render", "dusty.usda", "-o", "a.jpg", "--dry-run"]),
    "expected at least one output": ((), ["render", "dusty.usda"]),
    "expected one run of # in its name": ((), ["render", "dusty.usda", "-f", "1:2", "-o", "a.exr"]),
    "expected one size, or a whole multiple": (
        (),
        [*GOOD, "--holdout", "examples/blender/plate.exr", "--res", "300", "0"],
    ),
    "no channel that is called a depth": ((), [*GOOD, "--holdout", "examples/blender/textures/color_4C72FF.exr"]),
    "of a prim that is not there": (('over "Attic"', 'over "Attics"'), STRICT),
    "is not an attribute of a": (("photonbeams:intensity", "photonbeams:intensty"), STRICT),
    "has no render settings": ((), [*GOOD, "--render-settings", "/Render/Settings"]),
}


def test_every_message_of_the_guide_is_provoked():
    table = page("docs/guide.md").split("\n| message |")[1].split("\n\n")[0]
    assert re.findall(r"^\| `(.+?)` \|", table, re.MULTILINE) == list(PROVOKED)


@pytest.mark.parametrize("message", PROVOKED)
def test_a_message_of_the_guide_is_what_the_program_says(message, clone, capsys):
    change, arguments = PROVOKED[message]
    source = saved_files(page("docs/guide.md"))["dusty.usda"]
    assert not change or change[0] in source
    (clone / "dusty.usda").write_text(source.replace(*change) if change else source)
    assert call(arguments) in (1, 2)
    assert message in capsys.readouterr().err


# -- links -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*PAGES, "CHANGELOG.md"])
def test_every_link_and_picture_leads_somewhere(name):
    found = links(page(name))
    for path, anchor in found:
        target = ((ROOT / name).parent / path).resolve() if path else ROOT / name
        assert target.exists(), path
        assert target.is_relative_to(ROOT), path
        assert not anchor or anchor in anchors(target.read_text()), f"{path}#{anchor}"
    assert found or name in ("docs/dependencies.md", "docs/install.md", "docs/usdlux.md", "CHANGELOG.md")


def test_renders_are_small():
    pages = ("README.md", "docs/guide.md", "docs/stages.md", "docs/examples.md", "docs/beams.md", "docs/mitsuba.md")
    shown = {path for name in pages for path, _ in links(page(name)) if re.search(r"pictures/.*\.webp$", path)}
    assert len(shown) >= 12
    assert [path for path in shown if (ROOT / "docs/pictures" / path.split("/")[-1]).stat().st_size > 500_000] == []


def test_every_dependency_has_its_line():
    project = tomllib.loads(page("pyproject.toml"))
    more = project["project"]["optional-dependencies"]
    every = [*project["project"]["dependencies"], *(each for extra in more.values() for each in extra)]
    named = [*(each for each in every if not each.startswith("photonbeams[")), *project["build-system"]["requires"]]
    named = {re.match(r"[\w-]+", each)[0] for each in named}
    assert set(re.findall(r"photonbeams\[(\w+)\]` \|", page("docs/install.md"))) == {*more} - {"dev", "docs"}
    assert set(re.findall(r"^\| ([\w-]+) \| (?!for)", page("docs/dependencies.md"), re.MULTILINE)) == named


def test_the_version_without_a_tag_is_the_newest_of_the_change_log():
    newest = re.search(r"^## \[(\d.*?)\]", page("CHANGELOG.md"), re.MULTILINE)[1]
    assert tomllib.loads(page("pyproject.toml"))["tool"]["setuptools_scm"]["fallback_version"] == newest
    assert f"version: {newest}\n" in page("CITATION.cff")
