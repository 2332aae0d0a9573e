"""Opening what users name: every kind of path is a file, or a clause that says what it is, at once."""

import os
import socket

import numpy as np
import pytest

from photonbeams.runtime import inputs
from photonbeams.runtime.inputs import arrays, check_size, content, is_special, opened, why_unreadable
from photonbeams.scene import SceneError
from tests.helpers import mutations


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """Return paths of all kinds, with what each is called."""
    folder = tmp_path_factory.mktemp("kinds")
    os.mkfifo(folder / "pipe")
    (folder / "empty").touch()
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    (folder / "to pipe").symlink_to("pipe")
    with open(folder / "huge", "wb") as file:
        file.truncate(1 << 40)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "s"))
    names = {
        "pipe": "it is a named pipe", "to pipe": "it is a named pipe", "folder": "it is a folder",
        "s": "it is a socket", "empty": "it is empty", "huge": "it has 1,024 GiB: expected up to 4 KiB",
        "gone": "there is no such file", "loop": "Too many levels", "x" * 5000: "File name too long", "\0": "null",
    }  # fmt: skip
    devices = {path: "it is a device" for path in ("/dev/zero", "/dev/null", "/dev/tty") if os.path.exists(path)}
    return {**{folder / name: text for name, text in names.items()}, **devices}


def test_every_kind_of_path_is_called_what_it_is(kinds):
    for path, text in kinds.items():
        assert text in why_unreadable(path, 4096)
        for read in (lambda each: opened(each, 4096), lambda each: content(each, 4096), arrays):
            with pytest.raises(SceneError) as error:
                read(path)
            assert text in str(error.value) or path.name == "huge"
    special = {os.path.basename(path) for path in kinds if is_special(path)}
    assert special >= {"pipe", "to pipe", "s", "zero"} and not special & {"folder", "empty", "huge", "gone"}


def test_a_pointer_of_git_lfs_says_how_to_get_the_file(tmp_path):
    path = tmp_path / "stage.usd"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    assert "git lfs pull" in why_unreadable(path)
    path.write_text("version 2")
    assert not why_unreadable(path)


def test_a_file_that_becomes_a_pipe_is_not_waited_for(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "a")
    monkeypatch.setattr(inputs, "why_unreadable", lambda *_: "")
    with pytest.raises(SceneError, match="it is a named pipe"):
        opened(tmp_path / "a")


def test_a_file_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"123")
    assert why_unreadable(tmp_path / "a", 3) == "" and content(tmp_path / "a", 3) == b"123"


def test_what_is_too_large_for_the_memory_is_told(monkeypatch):
    monkeypatch.setattr(inputs, "memory", lambda: 1 << 20)
    check_size(1 << 20, 1e9, "it")
    with pytest.raises(SceneError, match="it takes 2 MiB: expected up to 1 MiB, the memory here"):
        check_size(2 << 20, 1e9, "it")


ARRAYS = {"a": np.arange(12.0, dtype=np.float32).reshape(3, 4), "b": np.array("text"), "c": np.array([1, 2])}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_are_those_that_numpy_wrote(tmp_path, save):
    save(tmp_path / "a.npz", **ARRAYS, e=np.zeros((0, 3)), f=np.asfortranarray(ARRAYS["a"]))
    found = arrays(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as expected:
        assert set(found) == set(expected)
        assert all(np.array_equal(found[name], expected[name]) for name in expected)


def test_a_damaged_archive_is_a_clause_or_what_it_was(tmp_path):
    np.savez(tmp_path / "a.npz", **ARRAYS)
    whole = (tmp_path / "a.npz").read_bytes()
    for seed in range(200):
        (tmp_path / "b.npz").write_bytes(mutations.damaged(whole, seed) or b"0")
        try:
            found = arrays(tmp_path / "b.npz")
        except SceneError as error:
            assert len(str(error)) <= 200, seed
            continue
        assert all(np.array_equal(found[name], ARRAYS[name]) for name in found), seed


def test_a_small_archive_cannot_claim_to_be_large(tmp_path, monkeypatch):
    monkeypatch.setattr(inputs, "_SMALL", 1000)
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(1 << 20))
    assert (tmp_path / "a.npz").stat().st_size < 1 << 14
    with pytest.raises(SceneError, match=r"what it holds takes 8 MiB: expected up to .* KiB"):
        arrays(tmp_path / "a.npz")
