"""Run first in workers of a local farm: leave signals of the terminal to the command, which ends its workers itself."""

import signal


def dask_setup(_: object) -> None:
    """Ignore Ctrl-C and SIGHUP, which a terminal sends to all processes."""
    for name in ("SIGINT", "SIGHUP"):  # Windows has no SIGHUP
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
