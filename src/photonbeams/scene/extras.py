"""Extras: packages that a part of the program needs, and that are not always installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .checks import SceneError


@contextmanager
def needs(extra: str, purpose: str, package: str) -> Iterator[None]:
    """Raise SceneError where a package cannot be imported, with the extra that brings it.

    Parameters
    ----------
    extra
        The extra of photonbeams.
    purpose
        What is wanted, as the subject of a sentence: "a farm".
    package
        The package's own name, as people know it.
    """
    try:
        yield
    except ImportError:
        raise SceneError(f"{purpose} needs {package}: expected `pip install 'photonbeams[{extra}]'`") from None
