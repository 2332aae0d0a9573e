"""Farms of real workers render the pixels of one process, even if they are killed, stopped or interrupted."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import distributed
import numpy as np
import psutil
import pytest

from photonbeams.farm import cluster
from photonbeams.farm.dispatch import Dispatcher, FramePart
from photonbeams.farm.run import Farm, FarmFrame
from photonbeams.farm.work import WorkerError
from photonbeams.images.files import read_layers
from photonbeams.scene import SceneError
from tests.helpers.commands import fails, same, until
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage

SMALL = ("--res", 24, 0, "--passes", 4, "--beams", 64)
MOVING = LAMP.replace(
    "float inputs:radius", "double3 xformOp:translate.timeSamples = { 1: (1, 0, 0), 9: (0, 1, 0) }\n"
    '    uniform token[] xformOpOrder = ["xformOp:translate"]\n    float inputs:radius',
)  # fmt: skip


@pytest.fixture
def stage(tmp_path):
    camera = CAMERA.replace("float focal", "double shutter:close = 0.5\n    float focal", 1)
    return write_stage(tmp_path / "stage.usda", FOG, camera, MOVING, FLOOR, metadata="startTimeCode = 1")


def start(*arguments, **more):
    """Start the command in a process of its own."""
    command = [sys.executable, "-m", "photonbeams", *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **more)


def workers_of(process):
    """Return the processes of a local cluster's workers."""
    found = []
    for each in psutil.Process(process.pid).children(recursive=True):
        with_name = each.cmdline()
        if any("spawn_main" in part for part in with_name):
            found.append(each)
    return found


@pytest.mark.soak  # workers that are killed and a scheduler's workers give the same frames, below
def test_frames_of_workers_are_those_of_one_process(render, stage, out):
    flags = (*SMALL, "-f", "1:3", "-q")
    assert render(stage, "-o", out / "serial.#.exr", *flags)[0] == 0
    before = {each.pid for each in psutil.Process().children(recursive=True)}
    code, _, stderr = render(stage, "-o", out / "farm.#.exr", *flags, "--workers", 2)
    assert (code, stderr) == (0, "")
    assert all(same(out / f"farm.{k}.exr", out / f"serial.{k}.exr") for k in (1, 2, 3))
    left = [each for each in psutil.Process().children(recursive=True) if each.pid not in before]
    assert not [each for each in left if "resource_tracker" not in " ".join(each.cmdline())]
    assert not list(Path.cwd().glob("dask-*"))


@pytest.mark.soak
def test_twenty_frames_a_worker_leave_nothing_and_need_no_more_memory(stage, out, tmp_path):
    begun, found, memory = time.time(), {}, []
    temporary = tmp_path / "temporary"  # not the usual one, in which other farms have files
    temporary.mkdir()
    flags = ("--res", 8, 0, "--passes", 1, "--beams", 16, "--workers", 2, "-q")
    own_folder = {**os.environ, "TMPDIR": str(temporary)}
    with start("render", stage, "-o", out / "a.###.exr", "-f", "1:40", *flags, env=own_folder) as process:
        while process.poll() is None:
            done = len(list(out.glob("a.*.exr")))
            with contextlib.suppress(psutil.Error):
                found |= {each.pid: each for each in psutil.Process(process.pid).children(recursive=True)}
                if done >= 12:
                    own = [*workers_of(process), psutil.Process(process.pid)]
                    memory.append(sum(each.memory_info().rss for each in own))
            time.sleep(0.3)
        assert process.wait() == 0, process.stderr.read()
    assert len(list(out.glob("a.*.exr"))) == 40
    quarter = max(1, len(memory) // 4)
    early, late = np.mean(memory[:quarter]), np.mean(memory[-quarter:])
    assert late < 1.1 * early, memory
    assert len(found) >= 2
    psutil.wait_procs(found.values(), timeout=10)  # Python's resource tracker ends after the command
    assert not [each for each in found.values() if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]
    folders = (temporary, Path.cwd(), out)
    left = [
        each for folder in folders for each in folder.iterdir() if each.name.startswith(("photonbeams-farm.", "dask-"))
    ]
    assert not [each for each in left if each.stat().st_mtime > begun]


def test_killed_and_stopped_workers_cost_no_frame(render, stage, out):
    flags = (*SMALL, "--passes", 8, "-f", "1:6")
    assert render(stage, "-o", out / "serial.#.exr", *flags, "-q")[0] == 0
    process = start("render", stage, "-o", out / "farm.#.exr", *flags, "--workers", 3, "--progress", "plain")
    try:
        until(lambda: list(out.glob("farm.*.exr")) or process.poll() is not None)
        assert process.poll() is None, process.stderr.read()
        killed, stopped, *_ = workers_of(process)
        killed.kill()
        stopped.suspend()
        _, stderr = process.communicate(timeout=300)
    finally:
        for each in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
            each.kill()
        process.kill()
    assert process.returncode == 0, stderr
    assert all(same(out / f"farm.{k}.exr", out / f"serial.{k}.exr") for k in range(1, 7))
    assert stderr.count("is lost; others render its passes again") >= 1  # the killed one; the other is slow


def test_an_interrupted_farm_goes_on_with_another_number_of_workers(render, stage, out):
    flags = (*SMALL, "--passes", 8, "-f", "1:3")
    assert render(stage, "-o", out / "serial.#.exr", *flags, "-q")[0] == 0
    process = start("render", stage, "-o", out / "farm.#.exr", *flags, "--workers", 2, "--checkpoint", 0.001)
    until(lambda: list(out.glob("farm.*.checkpoint")) or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=120)  # this also closes its pipes
    assert process.returncode == 130, stderr
    assert "Interrupted; " in stderr.splitlines()[-1]
    assert list(out.glob("farm.*.checkpoint"))
    again = ("--skip-existing", "--resume", "--checkpoint", 1000, "-q")
    code, _, stderr = render(stage, "-o", out / "farm.#.exr", *flags, *again, "--workers", 1)
    assert code == 0, stderr
    assert all(same(out / f"farm.{k}.exr", out / f"serial.{k}.exr") for k in (1, 2, 3))
    assert not list(out.glob("*.checkpoint"))


def test_what_a_worker_cannot_open_is_told_in_a_sentence(render, stage, out, monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 1)
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--scheduler", "tcp://127.0.0.1:1", "-q"), 75,
          "no Dask scheduler answers at tcp://127.0.0.1:1")  # fmt: skip
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--workers", 1, "--scheduler", "tcp://x:1"), 2, "two farms")
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--workers", 1, "--tls-cert", "a.pem"), 2, "tls://")
    fails(
        render(stage, "-o", out / "a.exr", *SMALL, "--workers", 1, "--time-limit", 1), 2, "--time-limit is for frames"
    )
    fails(render(stage, "-o", out / "a.checkpoint", *SMALL, "--workers", 1, "--pass-range", "0:1"), 2, "one process")


def test_a_frame_that_no_worker_can_render_is_named():
    """Also if the workers fail at different passes of it."""
    parts = FramePart(0, range(1)), FramePart(0, range(1, 2))
    farm = Farm(None, None, None, 0, [FarmFrame("8", 0, 2, None)], None, None, None)
    farm._dispatcher = Dispatcher([[each.numbers for each in parts]])
    farm._dispatcher.add_worker("a")
    farm._refuse("a", parts[0], WorkerError("names s.2.vdb"))
    with pytest.raises(SceneError, match=r"^frame 8: names s\.2\.vdb$"):
        farm._refuse("b", parts[1], WorkerError("names s.2.vdb"))


def test_only_who_has_its_key_enters_a_farm_on_one_machine():
    """Whoever may talk to a scheduler may run code in its process, and everybody on the machine may connect."""
    with cluster.connected(1) as client:
        workers = client.scheduler_info()["workers"]
        assert {each.partition("://")[0] for each in (client.scheduler.address, *workers)} == {"tls"}
        address = client.scheduler.address.removeprefix("tls://")
        strangers = [("tcp", None), ("tls", distributed.Security.temporary())]
        for scheme, key in strangers:
            with pytest.raises(OSError):
                distributed.Client(f"{scheme}://{address}", security=key, timeout=2, set_as_default=False)


@pytest.fixture
def scheduler(tmp_path):
    """Yield an address, and functions that start a scheduler and workers, in separate folders as on separate hosts."""
    started = []
    port = 18786

    def run(*command, folder):
        place = tmp_path / folder
        place.mkdir(exist_ok=True)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli." + command[0], *map(str, command[1:])], cwd=place,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        started.append(process)
        return process

    def worker(name):
        return run(
            "dask_worker", f"tcp://127.0.0.1:{port}", "--name", name, "--nthreads", 1, "--no-dashboard",
            "--local-directory", ".", folder=name,
        )  # fmt: skip

    def boss():
        return run("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", folder="boss")

    yield f"tcp://127.0.0.1:{port}", boss, worker
    for process in started:
        for child in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
            child.kill()
        process.kill()
        process.wait()


def test_a_running_scheduler_is_used_and_its_end_is_told(render, stage, out, scheduler):
    address, boss, worker = scheduler
    first = boss()
    for name in ("host1", "host2"):
        worker(name)
    flags = (*SMALL, "-f", "1:3")
    assert render(stage, "-o", out / "serial.#.exr", *flags, "-q")[0] == 0
    code, _, stderr = render(stage, "-o", out / "farm.#.exr", *flags, "-q", "--scheduler", address)
    assert (code, stderr) == (0, "")
    assert all(same(out / f"farm.{k}.exr", out / f"serial.{k}.exr") for k in (1, 2, 3))
    process = start("render", stage, "-o", out / "more.##.exr", *SMALL, "--passes", 16, "-f", "1:40",
                    "--scheduler", address, "--checkpoint", 1)  # fmt: skip
    until(lambda: list(out.glob("more.*.exr")) or process.poll() is not None)
    first.kill()
    _, stderr = process.communicate(timeout=120)
    last = stderr.splitlines()[-1]
    assert process.returncode == 75 and "the scheduler is gone: start it again" in last, stderr
    done = list(out.glob("more.*.exr"))
    assert done and all(read_layers(each) for each in done)
