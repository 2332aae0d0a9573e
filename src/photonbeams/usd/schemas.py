"""The codeless schemas of the folder `schema/`, known to OpenUSD once this module is imported."""

from __future__ import annotations

from pathlib import Path

from .openusd import INSTALLED, Plug

FOLDER = Path(__file__).parent / "schema"


def register() -> None:
    """Make the schemas known; once is enough, and more do no harm.

    OpenUSD builds its registry of schemas when the first stage is opened: a program that opens stages of its own
    before it imports this package reads the attributes all the same, but cannot define a `PhotonBeamsLook` by type.
    """
    Plug.Registry().RegisterPlugins(str(FOLDER))


if INSTALLED:
    register()
