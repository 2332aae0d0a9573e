"""Extras: optional packages, which only a part of the program needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .checks import SceneError


@contextmanager
def needs(extra: str, purpose: str, package: str) -> Iterator[None]:
    """Raise a SceneError that names the extra to install if a package cannot be imported within.

    Parameters
    ----------
    extra
        The extra of photonbeams that installs the package.
    purpose
        What the package is needed for, as the subject of a sentence: "a farm".
    package
        The name by which people know the package.
    """
    try:
        yield
    except ImportError:
        raise SceneError(f"{purpose} needs {package}: expected `pip install 'photonbeams[{extra}]'`") from None
