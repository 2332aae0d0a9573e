"""What every test needs: Dr.Jit on the CPU, hypothesis without deadlines, and fixtures of stages and of the command."""

import gc
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# Kernels compile on first use, so the first example of a property takes far longer than the rest.
settings.register_profile("photonbeams", deadline=None, derandomize=True)
settings.load_profile("photonbeams")

# References are stored for the CPU; PHOTONBEAMS_DEVICE=cuda runs the same tests on a GPU.
os.environ.setdefault("PHOTONBEAMS_DEVICE", "cpu")

# Some tests send these signals. They may be ignored where a shell started the tests in the background.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Before any test imports Dr.Jit: this import chooses the libLLVM that Dr.Jit loads.
import photonbeams  # noqa: E402, F401

# New objects after which Python collects garbage by itself: 70 times its own number.
_OBJECTS = 50_000

# A test that takes longer, in seconds, may have rendered something.
_RENDERED = 0.2

if "PYTEST_XDIST_WORKER" in os.environ:  # or each process would start a thread for each processor
    from photonbeams.runtime import device, limits

    # Most kernels of tests are small, and threads that wait for their part of one keep a processor busy: with two
    # threads in each of two processes, tests take half as long again as with one.
    device.set_threads(max(1, limits.processors() // int(os.environ["PYTEST_XDIST_WORKER_COUNT"])))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol() -> Iterator[object]:
    """Collect the garbage of each test that may have rendered something.

    Kernels have code for the plugins of every Mitsuba scene in memory. What a test leaves in a cycle of references
    makes later tests compile other kernels, and slower ones.
    """
    begun = time.perf_counter()
    result = yield
    if time.perf_counter() - begun > _RENDERED:
        gc.collect()
    return result


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of `make soak`."""
    parser.addoption("--soak", action="store_true", help="run the whole of long sweeps, as `make soak` does")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is for `make soak` alone, unless a test is asked for by its name."""
    if config.getoption("--soak"):
        return
    named = tuple(each for each in config.args if "::" in each)
    left_out = [item for item in items if item.get_closest_marker("soak") and not item.nodeid.startswith(named)]
    config.hook.pytest_deselected(items=left_out)
    gone = set(left_out)
    items[:] = [item for item in items if item not in gone]


def pytest_collection_finish() -> None:
    """Leave what there is before the first test out of collections: modules and tests, a million objects.

    A collection looked at all of them, and took as long as a small render. Between tests that render, whose garbage is
    collected above, few collections are needed.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(_OBJECTS, *gc.get_threshold()[1:])


def pytest_unconfigure() -> None:
    """Let the end of the process collect everything, or libraries print what they take for leaks."""
    gc.unfreeze()


@pytest.fixture
def rng():
    """Return a NumPy random generator with a fixed seed."""
    return np.random.default_rng(7)


@pytest.fixture
def set_threads():
    """Yield a function that sets the number of threads, which is restored after the test."""
    import drjit as dr

    from photonbeams.runtime import device

    device.backend()
    before = dr.thread_count()
    yield device.set_threads
    device.set_threads(before)


@pytest.fixture(scope="module")
def helping_thread():
    """Let the tests of a module read and write OpenEXR files by Mitsuba itself."""
    from photonbeams.runtime import device

    with device.helping_thread():
        yield


Opener = Callable[..., object]


@pytest.fixture
def usd(tmp_path: Path) -> Opener:
    """Return a function that writes and opens a stage with these prims and metadata."""

    from photonbeams.usd.stage import open_stage

    def opened(text: str, metadata: str = "") -> object:
        # OpenUSD caches the layers that are in use, so each stage of a test has a file of its own.
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        path = folder / "stage.usda"
        body = text.replace(" }", "\n}")  # a statement in USD ends at the end of a line
        path.write_text(f"#usda 1.0\n(\n{metadata}\n)\n{body}\n")
        return open_stage(path)

    return opened


@pytest.fixture
def scene(usd: Opener) -> Callable[..., object]:
    """Return a function that writes and reads a stage: unreadable parts are errors, as with --strict."""

    from photonbeams.usd.common.warnings import Warnings
    from photonbeams.usd.stage import default_time, read_scene

    class Failing(Warnings):
        def give(self, *given: str) -> None:
            self.strict = False
            super().give(*given)
            self.strict = True

        def lack(self, *given: str, frame: float | None = None) -> None:
            self.strict = False
            super().lack(*given, frame=frame)
            self.strict = True

    def read(text: str, metadata: str = "") -> object:
        stage = usd(text, metadata)
        return read_scene(stage, default_time(stage), Failing(strict=True))

    return read


@pytest.fixture
def image(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes an image without converting its values, and returns its path."""

    import OpenImageIO

    def written(name: str, pixels: list, kind: str = "uint8") -> Path:
        values = np.asarray(pixels, dtype=np.float32)
        path = tmp_path / "images" / name
        path.parent.mkdir(exist_ok=True)
        spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
        spec.attribute("oiio:UnassociatedAlpha", 1)
        file = OpenImageIO.ImageOutput.create(str(path))
        assert file.open(str(path), spec)
        assert file.write_image(values)
        file.close()
        return path

    return written


@pytest.fixture
def call(capfd):
    """Return a function that calls the command and returns its exit code, its standard output and its error output."""

    from photonbeams import cli

    def called(command, *arguments):
        begun = time.perf_counter()
        with pytest.raises(SystemExit) as stop:
            cli.main([command, *map(str, arguments)])
        code = stop.value.code
        del stop
        if time.perf_counter() - begun > _RENDERED:
            gc.collect()  # or what an interrupted render leaves would make a test's next one compile other kernels
        return (code, *capfd.readouterr())

    return called


@pytest.fixture
def render(call):
    """Return a function that calls `photonbeams render`."""
    return lambda *arguments: call("render", *arguments)


@pytest.fixture
def out(tmp_path):
    """Return the output folder, which already holds an old file."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "old.exr").write_bytes(b"yesterday")
    return folder
