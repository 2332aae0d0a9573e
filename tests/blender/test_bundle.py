"""The renderer that comes with the extension: it is unpacked whole, or not at all, by however many Blenders at once."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import photonbeams.blender
from photonbeams.blender.extension.bundle import LIST, Bundle, NoRendererError, NotYetError
from photonbeams.blender.extension.process import VARIABLE, Python, python_of
from tests.helpers.disks import limited
from tools.extension import pack

PACKAGES = "lib/python3.11/site-packages"
MODULE = f"{PACKAGES}/photonbeams/__init__.py"
COUNT = 800  # of the small files of an archive that takes a while
# A Blender that unpacks the renderer, and prints how many files it found.
BLENDER = f"""
import sys, time
sys.path.insert(0, {str(Path(photonbeams.blender.__file__).parent)!r})
from pathlib import Path
from extension.bundle import Bundle, NotYetError
bundle = Bundle.within(*map(Path, sys.argv[1:]))
while True:
    try:
        print(len(list(Path(bundle.packages()).iterdir())))
        break
    except NotYetError:
        time.sleep(0.002)
"""


def extension(folder, files):
    """Return the folder of an extension with an archive of files of these contents."""
    for name, content in files.items():
        (folder / "content" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "content" / name).write_bytes(content)
    (folder / "extension").mkdir()
    pack(folder / "content", folder / "extension" / "renderer-1.tar.xz", folder / "kept")
    return folder / "extension"


@pytest.fixture
def folder(tmp_path):
    """The folder of an extension with an archive of 64 kB."""
    return extension(tmp_path, {MODULE: os.urandom(65_536)})


def packages(bundle):
    """Return what a bundle returns once it is unpacked."""
    while True:
        try:
            return bundle.packages()
        except NotYetError as waiting:
            assert re.fullmatch(r"Checking the renderer|Unpacking the renderer, once: \d+%", str(waiting))
            time.sleep(0.01)


def test_an_extension_without_an_archive_has_no_bundle(tmp_path):
    assert Bundle.within(tmp_path, tmp_path) is None


def test_it_is_unpacked_once_and_what_others_left_is_removed(folder, tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    user = tmp_path / "user"
    for old in ("renderer-0", "renderer-1.a.part", "renderer-1.b.part"):  # of another version, and of processes
        (user / old).mkdir(parents=True)
    os.utime(user / "renderer-1.a.part", (0, 0))  # this one was killed
    found = packages(Bundle.within(folder, user))
    assert found == str(user / "renderer-1" / PACKAGES)
    assert {path.name for path in user.iterdir()} == {"renderer-1", "renderer-1.b.part"}
    (folder / "renderer-1.tar.xz").write_bytes(b"")  # it is not read again
    again = Bundle.within(folder, user)
    assert packages(again) == found and python_of("", again) == Python(sys.executable, found)


@pytest.mark.parametrize("name", [MODULE, LIST])
@pytest.mark.parametrize("content", [None, b"", b"cut"])
def test_an_incomplete_one_from_before_is_unpacked_again(folder, tmp_path, name, content):
    user = tmp_path / "user"
    packages(Bundle.within(folder, user))
    whole, broken = tmp_path / "content" / MODULE, user / "renderer-1" / name
    broken.unlink() if content is None else broken.write_bytes(content)
    packages(Bundle.within(folder, user))
    assert (user / "renderer-1" / MODULE).read_bytes() == whole.read_bytes()
    assert [path.name for path in user.iterdir()] == ["renderer-1"]


def test_several_blenders_at_once_of_which_some_are_killed_each_find_it_whole(tmp_path):
    user = tmp_path / "user"
    there = extension(tmp_path, {f"{PACKAGES}/{number}.py": os.urandom(500) for number in range(COUNT)})
    (user / "renderer-1" / PACKAGES).mkdir(parents=True)  # what an earlier version left, and took for whole
    command = [sys.executable, "-I", "-c", BLENDER, there, user]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(4)]
    for number, killed in ((20, running[0]), (COUNT // 2, running[1])):
        while killed.poll() is None and not any(user.glob(f"*.part/**/{number}.py")):
            time.sleep(0.002)
        killed.kill()
    found = [each.communicate(timeout=60)[0] for each in running]
    assert [int(each) for each in found[2:]] == [COUNT, COUNT]
    found = subprocess.run(command, capture_output=True, check=True).stdout
    assert int(found) == COUNT and (user / "renderer-1" / LIST).exists()


def test_a_chosen_python_comes_first(folder, tmp_path):
    assert python_of("/chosen", Bundle.within(folder, tmp_path / "user")) == Python("/chosen")


def test_an_archive_that_is_cut_off_is_a_sentence_and_leaves_nothing(folder, tmp_path):
    whole = (folder / "renderer-1.tar.xz").read_bytes()
    (folder / "renderer-1.tar.xz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(NoRendererError, match=r"cannot be unpacked in .* expected a disk"):
        packages(Bundle.within(folder, tmp_path / "user"))
    assert not [*(tmp_path / "user").iterdir()]


def test_a_full_disk_is_a_sentence_and_leaves_nothing(folder, tmp_path):
    with limited(1 << 14), pytest.raises(NoRendererError, match="cannot be unpacked") as raised:
        packages(Bundle.within(folder, tmp_path / "user"))
    assert len(str(raised.value)) <= 300 + len(str(tmp_path)) and not [*(tmp_path / "user").iterdir()]
