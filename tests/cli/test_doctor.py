"""What all commands share (help, exit codes, error messages), and `photonbeams doctor`."""

import errno
import subprocess
import sys

import pytest

from photonbeams import cli
from photonbeams.runtime.device import DeviceError
from photonbeams.scene import SceneError


def run(*arguments, **environment):
    """Run a command line and return its finished process."""
    import os

    command = [sys.executable, "-m", "photonbeams", *arguments]
    return subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)


@pytest.fixture
def failing(monkeypatch):
    """Return a function that runs a command which raises a given error, and returns its exit code."""

    def run_failing(error):
        def doctor():
            raise error

        monkeypatch.setattr("photonbeams.cli.doctor.doctor", doctor)
        with pytest.raises(SystemExit) as ending:
            cli.main(["doctor"])
        return ending.value.code

    return run_failing


def test_the_machine_that_runs_the_tests_can_render():
    child = run("doctor")
    assert child.returncode == 0 and "This machine can render" in child.stdout
    assert all(word in child.stdout for word in ("mitsuba", "Backend", "CUDA"))


def test_a_machine_that_cannot_render_is_told_why():
    child = run("doctor", DRJIT_LIBLLVM_PATH="/nowhere", PHOTONBEAMS_DEVICE="cpu")
    assert child.returncode == 1
    assert "This machine cannot render: DRJIT_LIBLLVM_PATH names /nowhere" in child.stdout
    assert "Traceback" not in child.stdout + child.stderr


def test_a_library_that_kills_its_process_does_not_kill_the_doctor(monkeypatch, capsys):
    from photonbeams.cli import doctor

    monkeypatch.setattr(doctor, "_TRIAL", "import os; os.abort()")
    with pytest.raises(SystemExit) as ending:
        cli.main(["doctor"])
    assert ending.value.code == 1
    assert "This machine cannot render: the test kernel ended in SIGABRT" in capsys.readouterr().out


def test_a_gpu_that_kills_the_process_is_not_taken_for_a_library(monkeypatch):
    from photonbeams.cli import doctor

    monkeypatch.setattr(doctor, "_TRIAL", "import os; print('cuda', flush=True); os.abort()")
    problem, crashed = doctor.trial()
    assert crashed and problem.startswith("the test kernel ended in SIGABRT on CUDA: set PHOTONBEAMS_DEVICE=cpu")


def test_a_kernel_with_a_wrong_result_is_reported(monkeypatch):
    from photonbeams.cli import doctor

    monkeypatch.setattr(doctor, "_TRIAL", "import sys; sys.exit('a ray met a sphere at 3 instead of 2')")
    assert doctor.trial() == ("the test kernel failed: a ray met a sphere at 3 instead of 2", False)


def test_the_version_is_the_package_s():
    from photonbeams import __version__

    assert run("--version").stdout.strip() == f"photonbeams {__version__}"


def test_help_imports_nothing_heavy():
    code = """if True:
    import sys
    from photonbeams.cli import main
    try:
        main(["--help"])
    except SystemExit as ending:
        print(ending.code, *sorted({"drjit", "mitsuba", "pxr", "OpenImageIO", "matplotlib"} & set(sys.modules)))
    """
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert child.stdout.splitlines()[-1] == "0"


@pytest.mark.parametrize("arguments", [["docter"], ["doctor", "--loud"], []])
def test_bad_usage_ends_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as ending:
        cli.main(arguments)
    assert ending.value.code == 2
    assert "Did you mean 'doctor'" in capsys.readouterr().err or arguments != ["docter"]


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (SceneError("room.usda: there is no camera"), "room.usda: there is no camera"),
        (
            DeviceError("device is cuda, but no NVIDIA driver was found"),
            "device is cuda, but no NVIDIA driver was found",
        ),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "a.exr"), "a.exr: No such file or directory"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
        (MemoryError(), "not enough memory for this many beams and pixels on this device"),
        (
            RuntimeError("jit_malloc(): out of memory!"),
            "not enough memory for this many beams and pixels on this device",
        ),
    ],
)
def test_an_error_of_the_user_is_one_sentence(error, sentence, failing, capsys, monkeypatch):
    monkeypatch.delenv("PHOTONBEAMS_TRACEBACK", raising=False)
    assert failing(error) == 1
    assert capsys.readouterr().err == f"Error: {sentence}\n"


def test_ctrl_c_is_one_sentence(failing, capsys):
    assert failing(KeyboardInterrupt()) == 130
    assert capsys.readouterr().err == "Interrupted; nothing was written\n"


def test_the_traceback_is_shown_on_request(failing, monkeypatch):
    monkeypatch.setenv("PHOTONBEAMS_TRACEBACK", "1")
    with pytest.raises(SceneError, match="no camera"):
        failing(SceneError("there is no camera"))


def test_a_fault_of_the_program_keeps_its_traceback(failing):
    with pytest.raises(ZeroDivisionError):
        failing(ZeroDivisionError())
