"""Run first in workers of a local farm: leave signals of the terminal to the command, which ends its workers itself.

Their messages look like those of the command.
"""

import logging
import signal


def dask_setup(_: object) -> None:
    """Ignore Ctrl-C and SIGHUP, which a terminal sends to all processes; print warnings as the command does."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("Warning: %(message)s"))
    logging.getLogger("photonbeams").addHandler(handler)
    for name in ("SIGINT", "SIGHUP"):  # Windows has no SIGHUP
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
