"""Clusters: workers on this machine, or those of a running Dask scheduler."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from ..runtime.files import temporary_folder
from ..runtime.limits import memory
from ..scene.extras import needs

if TYPE_CHECKING:
    from types import ModuleType

    from distributed import Client

#: Name of a worker's memory, in bytes, among Dask's resources.
MEMORY = "memory"

_CONNECT_SECONDS = 10


class FarmError(Exception):
    """The farm failed, for the reason in the message; the same work may succeed if it is started again."""

    exit_code = 75  # EX_TEMPFAIL of sysexits.h


@contextmanager
def connected(
    workers: int | None, scheduler: str | None = None, tls: Mapping[str, str] | None = None
) -> Iterator[Client]:
    """Yield a client of a cluster; a local cluster ends with it and leaves no process or folder behind.

    Whoever can talk to a scheduler can run code in it. A local one talks by TLS, with a key that this process made and
    that only its workers have.

    FarmError if the scheduler does not answer or local workers do not start; SceneError if Dask is not installed.

    Parameters
    ----------
    workers
        How many to start on this machine, unless there is a scheduler.
    scheduler, tls
        The address of a running Dask scheduler, such as tcp://farm:8786 or tls://farm:8786; and files for TLS, by the
        names `ca`, `cert` and `key`.
    """
    with needs("farm", "a farm", "Dask"):
        import cryptography  # noqa: F401 (Dask makes keys with it)
        import dask
        import distributed
    logging.getLogger("distributed").setLevel(
        logging.CRITICAL
    )  # photonbeams reports lost workers itself, in one sentence
    settings: dict[str, Any] = {f"distributed.worker.memory.{each}": False for each in ("spill", "target", "pause")}
    settings["distributed.comm.timeouts.connect"] = f"{_CONNECT_SECONDS}s"
    settings["distributed.scheduler.worker-ttl"] = "60s"
    with dask.config.set(settings):
        if scheduler is None:
            with _local(dask, distributed, workers or 1) as client:
                yield client
        else:
            with _running(distributed, scheduler, tls) as client:
                yield client


def dashboard(client: Client) -> str | None:
    """Return the address of Dask's dashboard, or None if Bokeh, which draws it, is not installed."""
    if find_spec("bokeh") is None or "dashboard" not in client.scheduler_info(n_workers=0)["services"]:
        return None
    return str(client.dashboard_link)


@contextmanager
def _local(dask: ModuleType, distributed: ModuleType, count: int) -> Iterator[Client]:
    limit = (memory() or 0) // count
    with temporary_folder("farm") as folder, dask.config.set({"temporary-directory": folder}):
        try:
            cluster = distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1",
                dashboard_address="127.0.0.1:0", memory_limit=limit or "auto",
                resources={MEMORY: limit} if limit else None, local_directory=folder, silence_logs=logging.CRITICAL,
                preload=["photonbeams.farm.preload"], security=True,
            )  # fmt: skip
        except (RuntimeError, OSError, TimeoutError) as error:  # its processes do not start
            raise FarmError(f"the workers of the farm do not start: {' '.join(str(error).split())[:200]}") from None
        with cluster, distributed.Client(cluster, set_as_default=False, direct_to_workers=True) as client:
            yield client


@contextmanager
def _running(distributed: ModuleType, address: str, tls: Mapping[str, str] | None) -> Iterator[Client]:
    security = None
    if tls:
        names = {"ca": "tls_ca_file", "cert": "tls_client_cert", "key": "tls_client_key"}
        security = distributed.Security(require_encryption=True, **{names[name]: path for name, path in tls.items()})
    try:
        client = distributed.Client(
            address, security=security, timeout=_CONNECT_SECONDS, set_as_default=False, direct_to_workers=True
        )
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        reason = " ".join(str(error).split())[:120]
        raise FarmError(f"no Dask scheduler answers at {address}: {reason}") from None
    with client:
        yield client
