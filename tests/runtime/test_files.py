"""Files are written whole or not at all."""

import os
import subprocess
from pathlib import Path

import pytest

from photonbeams.runtime import files
from photonbeams.runtime.files import atomic_path, temporary_folder, try_path


def test_a_failed_writer_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(b"yesterday")
    for failure in (KeyboardInterrupt, ValueError):
        with pytest.raises(failure), atomic_path(path) as beside:
            beside.write_bytes(b"half")
            raise failure
    assert path.read_bytes() == b"yesterday"
    assert list(tmp_path.iterdir()) == [path]


def test_another_files_error_keeps_that_files_name(tmp_path):
    with pytest.raises(FileNotFoundError) as error, atomic_path(tmp_path / "a.npz"):
        (tmp_path / "source.txt").read_bytes()
    assert error.value.filename == str(tmp_path / "source.txt")


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    path = tmp_path / "a.npz"
    with atomic_path(path) as first:
        with atomic_path(path) as second:
            first.write_bytes(b"first")
            second.write_bytes(b"second")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"


def test_a_trial_leaves_no_trace(tmp_path):
    try_path(tmp_path / "sub" / "a.npz")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.npz").mkdir()
    with pytest.raises(IsADirectoryError):
        try_path(tmp_path / "a.npz")


def test_what_killed_writers_left_goes_and_what_others_write_stays(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    names = {
        "dead": f".a.{files._HOST}-{ended.pid}-0123456789ab.tmp.exr",
        "alive": f".a.{files._HOST}-{os.getppid()}-0123456789ab.tmp.exr",
        "elsewhere": ".a.00000000ff-1-0123456789ab.tmp.exr",
        "old": ".b.00000000ff-1-0123456789ab.tmp.exr",
        "mine": ".a.0123-1.tmp.exr",
    }
    for name in names.values():
        (tmp_path / name).touch()
    os.utime(tmp_path / names["old"], (0, 0))
    os.utime(tmp_path / names["mine"], (0, 0))
    with atomic_path(tmp_path / "a.exr"):
        pass
    assert {each.name for each in tmp_path.iterdir()} == {"a.exr", names["alive"], names["elsewhere"], names["mine"]}


def test_temporary_folders_of_killed_processes_go(tmp_path, monkeypatch):
    ended = subprocess.Popen(["true"])
    ended.wait()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    names = {
        "dead": f"photonbeams-farm.{files._HOST}-{ended.pid}-ab_1",
        "alive": f"photonbeams-farm.{files._HOST}-{os.getppid()}-ab_1",
        "elsewhere": "photonbeams-studio.00000000ff-1-ab_1",
        "mine": "photonbeams-farm.backup",
    }
    for name in names.values():
        (tmp_path / name / "scratch").mkdir(parents=True)
    with temporary_folder("farm") as folder:
        own = Path(folder).name
        assert {each.name for each in tmp_path.iterdir()} == {own, *names.values()} - {names["dead"]}
    assert own.startswith(f"photonbeams-farm.{files._HOST}-{os.getpid()}-") and not Path(folder).exists()


def test_a_folder_made_for_a_file_that_is_not_written_goes(tmp_path):
    with pytest.raises(ValueError), atomic_path(tmp_path / "new" / "sub" / "a.npz"):
        raise ValueError
    assert list(tmp_path.iterdir()) == []


def test_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "a.exr")
    with pytest.raises(OSError, match=r"it is a device or a pipe"), atomic_path(tmp_path / "a.exr"):
        pass
    assert (tmp_path / "a.exr").is_fifo()


def test_a_link_stays_one_and_its_file_is_written(tmp_path):
    (tmp_path / "link.txt").symlink_to(tmp_path / "published" / "real.txt")
    with atomic_path(tmp_path / "link.txt") as beside:
        beside.write_text("new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "published" / "real.txt").read_text() == "new"
