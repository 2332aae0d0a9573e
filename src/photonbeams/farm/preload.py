"""What the workers of a local farm do first: leave Ctrl-C to the command, which ends them in order."""

import signal
from typing import Any


def dask_setup(_: Any) -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
