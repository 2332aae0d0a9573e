"""Limits of the system are reported before libraries crash at them."""

import os
import resource

import numpy as np
import pytest

from photonbeams.runtime import limits
from photonbeams.runtime.limits import check_address_space, check_working_folder


@pytest.mark.parametrize(
    ("limit", "more", "expected"),
    [
        (1 << 30, 0, "is 1 GiB: expected at least 2.25 GiB"),
        (3 << 30, 1 << 30, "is 3 GiB: expected at least 3.25 GiB, or a smaller --res"),
        (3 << 30, 0, None),
        (resource.RLIM_INFINITY, 1 << 50, None),
    ],
)
def test_a_limit_of_memory_is_told(monkeypatch, limit, more, expected):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    if expected is None:
        check_address_space(more)
        return
    with pytest.raises(OSError) as error:
        check_address_space(more)
    assert error.value.strerror == f"the limit of virtual memory (ulimit -v) {expected}"


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """Return a function that makes control groups of /proc/self/cgroup's lines and of files with their texts."""

    def make(lines, files):
        (tmp_path / "cgroup").write_text(lines)
        for name, text in files.items():
            path = tmp_path / "fs" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        monkeypatch.setattr(limits, "_GROUPS", tmp_path / "cgroup")
        monkeypatch.setattr(limits, "_ROOT", tmp_path / "fs")
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(8), raising=False)
        monkeypatch.setattr(limits, "_pages", lambda _: 64 << 30)

    return make


@pytest.mark.parametrize(
    ("lines", "files", "memory", "processors"),
    [
        ("0::/\n", {}, 64, 8),
        ("0::/\n", {"memory.max": "max\n", "cpu.max": "max 100000\n"}, 64, 8),
        # A container of Docker's or a pod: the group is the root of what it sees.
        ("0::/\n", {"memory.max": f"{4 << 30}\n", "cpu.max": "150000 100000\n"}, 4, 2),
        # A group of the machine that the container does not see.
        ("0::/system.slice/docker-1.scope\n", {"memory.max": f"{4 << 30}\n", "cpu.max": "50000 100000\n"}, 4, 1),
        # The least of the groups around this one, as systemd and Slurm make them.
        (
            "0::/a/b\n",
            {"a/b/memory.max": f"{8 << 30}\n", "a/memory.max": f"{2 << 30}\n", "a/cpu.max": "300000 100000"},
            2, 3,
        ),
        # Version 1: each controller has a folder; -1 and the largest multiple of a page mean no limit.
        (
            "5:cpuacct,cpu:/job\n4:memory:/job\n0::/\n",
            {"memory/job/memory.limit_in_bytes": f"{3 << 30}\n",
             "memory/memory.limit_in_bytes": "9223372036854771712\n",
             "cpu/job/cpu.cfs_quota_us": "400000\n", "cpu/job/cpu.cfs_period_us": "100000\n"},
            3, 4,
        ),
        ("4:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 64, 8),
    ],
)  # fmt: skip
def test_a_container_has_the_memory_and_the_processors_of_its_groups(groups, lines, files, memory, processors):
    groups(lines, files)
    assert (limits.memory(), limits.processors()) == (memory << 30, processors)


def test_memory_and_processors_are_those_of_the_shell_and_of_the_scheduler(groups, monkeypatch):
    groups("0::/\n", {"memory.max": f"{4 << 30}\n"})
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3}, raising=False)
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (1 << 30 if kind == resource.RLIMIT_DATA else -1, -1))
    assert (limits.memory(), limits.processors()) == (1 << 30, 1)


@pytest.mark.skipif(limits._data() is None, reason="the system does not tell how much data a process has")
def test_what_is_read_within_a_bound_takes_no_more():
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with limits.bounded(1 << 28):
        with limits.bounded(1 << 28), pytest.raises(MemoryError):
            np.empty(1 << 29, np.uint8)
        assert resource.getrlimit(resource.RLIMIT_DATA) != before  # until all have left
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
    assert len(np.empty(1 << 29, np.uint8)) == 1 << 29


def test_a_working_folder_that_was_deleted_is_told(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    check_working_folder()
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError, match="the working folder is not there: expected one that exists"):
        check_working_folder()
