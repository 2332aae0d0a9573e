"""The codeless schemas in the folder `schema/`; importing this module registers them with OpenUSD."""

from __future__ import annotations

from pathlib import Path

from .openusd import INSTALLED, Plug

FOLDER = Path(__file__).parent.parent / "schema"


def register() -> None:
    """Register the schemas; repeated calls do no harm.

    OpenUSD builds its registry of schemas when the first stage is opened. A program that opens a stage before it
    imports this package can still read the attributes, but cannot define a `PhotonBeamsLook` by type.
    """
    Plug.Registry().RegisterPlugins(str(FOLDER))


if INSTALLED:
    register()
