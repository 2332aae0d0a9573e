"""The renderer that comes with the extension: it is unpacked once, whole or not at all."""

import re
import sys
import tarfile
import time

import pytest

from photonbeams.blender.extension.bundle import Bundle, NoRendererError, NotYetError
from photonbeams.blender.extension.process import Python, python_of
from tests.helpers.disks import limited

MODULE = "lib/python3.11/site-packages/photonbeams/__init__.py"


@pytest.fixture
def folder(tmp_path):
    """The folder of an extension with an archive of 64 kB."""
    (tmp_path / "content" / MODULE).parent.mkdir(parents=True)
    (tmp_path / "content" / MODULE).write_text("# " + "x" * 65_536)
    (tmp_path / "extension").mkdir()
    with tarfile.open(tmp_path / "extension" / "renderer-1.tar.xz", "w:xz") as archive:
        archive.add(tmp_path / "content", ".")
    return tmp_path / "extension"


def packages(bundle):
    """Return what a bundle returns once it is unpacked."""
    while True:
        try:
            return bundle.packages()
        except NotYetError as waiting:
            assert re.fullmatch(r"Unpacking the renderer, once: \d+%", str(waiting))
            time.sleep(0.01)


def test_an_extension_without_an_archive_has_no_bundle(tmp_path):
    assert Bundle.within(tmp_path, tmp_path) is None


def test_it_is_unpacked_once_and_an_older_one_is_removed(folder, tmp_path):
    user = tmp_path / "user"
    for old in ("renderer-0", "renderer-1.part"):  # of another version, and of a process that was killed
        (user / old).mkdir(parents=True)
    found = packages(Bundle.within(folder, user))
    assert found == str(user / "renderer-1" / MODULE).removesuffix("/photonbeams/__init__.py")
    assert [path.name for path in user.iterdir()] == ["renderer-1"]
    (folder / "renderer-1.tar.xz").write_bytes(b"")  # it is not read again
    again = Bundle.within(folder, user)
    assert again.packages() == found and python_of("", again) == Python(sys.executable, found)


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
