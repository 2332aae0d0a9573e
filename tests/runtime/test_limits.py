"""Limits of the system are reported before libraries crash at them."""

import resource

import pytest

from photonbeams.runtime.device import check_address_space


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
