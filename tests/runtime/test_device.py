"""The choice of libLLVM or CUDA, most of it in child processes, since Dr.Jit can be started only once."""

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from photonbeams.runtime import device, libllvm, limits
from photonbeams.runtime.device import DeviceError

needs_llvm = pytest.mark.skipif(libllvm.best() is None, reason="no libLLVM that works is installed")


def run(code, **environment):
    """Return what `code` prints in a new process in which no device is chosen, or the last line of its error output."""
    inherited = {k: v for k, v in os.environ.items() if k not in ("DRJIT_LIBLLVM_PATH", "PHOTONBEAMS_DEVICE")}
    child = subprocess.run([sys.executable, "-c", code], env=inherited | environment, capture_output=True, text=True)
    return child.stdout.strip() if child.returncode == 0 else child.stderr.strip().splitlines()[-1]


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Return an empty folder, in which the libraries of the machine are looked for, and the packages of Python."""
    monkeypatch.setattr(libllvm, "_library_paths", lambda: iter(sorted(map(str, tmp_path.glob("libLLVM*")))))
    monkeypatch.setattr(sys, "path", [str(tmp_path / "site-packages")])
    libllvm.candidates.cache_clear()
    yield tmp_path
    libllvm.candidates.cache_clear()


# -- Finding libLLVM -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM.so.22.1", (22, 1)),
        ("libLLVM-17.so.1", (17,)),
        ("libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("libLLVM-19.so", (19,)),
        ("libLLVM.so", ()),
        ("libLLVM.dylib", ()),
        ("libLLVM.so.18.1-rust", None),
        ("libLLVMSupport.a", None),
        ("libLLVMSPIRVLib.so.15", None),
    ],
)
def test_the_version_is_read_from_the_file_name(name, version):
    assert libllvm._version_in_name(f"/usr/lib/{name}") == version


def test_old_versions_are_refused_by_name_and_never_loaded(machine, monkeypatch):
    for name in ("libLLVM-14.so.1", "libLLVM-15.so.1", "libLLVM-16.so.1"):
        (machine / name).touch()
    monkeypatch.setattr(libllvm, "_probe", lambda path: pytest.fail(f"{path} was loaded"))
    assert libllvm.best() is None
    assert [c.problem.split(";")[0] for c in libllvm.candidates()] == [
        "aborts on AVX-512 machines",
        "aborts on AVX-512 machines",
        "too old for Dr.Jit",
    ]


@needs_llvm
def test_a_library_that_does_not_load_gives_way_to_the_next(machine):
    real = Path(os.environ["DRJIT_LIBLLVM_PATH"])
    (machine / "libLLVM.so.99.1").write_bytes(b"no library")
    # Loading this one kills its process with SIGBUS.
    (machine / "libLLVM.so.98.1").write_bytes(real.read_bytes()[: real.stat().st_size // 3])
    (machine / "libLLVM.so").symlink_to(real)
    assert libllvm.best() == os.path.realpath(real)
    assert [bool(c.problem) for c in libllvm.candidates()] == [True, True, False]
    assert all("does not load" in c.problem for c in libllvm.candidates()[:2])


def test_links_to_one_library_count_once(machine):
    (machine / "libLLVM.so.15.0").touch()
    (machine / "libLLVM-15.so").symlink_to("libLLVM.so.15.0")
    assert len(libllvm.candidates()) == 1


def packaged(machine):
    """Install a `karellen-llvm-core` as pip does, whose library is empty, and return the library's path."""
    information = machine / "site-packages" / "karellen_llvm_core-22.1.8.dist-info"
    library = machine / "venv" / "lib" / "libLLVM.so.22.1"
    for path in (information / "METADATA", library):
        path.parent.mkdir(parents=True)
    library.touch()
    (library.parent / "libLLVM.so").symlink_to(library.name)
    (information / "METADATA").write_text("Name: karellen-llvm-core\nVersion: 22.1.8\n")
    names = ("libLTO.so.22.1", "libLLVM.so", "libLLVM.so.22.1")
    (information / "RECORD").write_text("".join(f"../venv/lib/{name},,\n" for name in names))
    return str(library)


def test_the_package_s_library_comes_before_a_newer_one_of_the_system(machine, monkeypatch):
    monkeypatch.setattr(libllvm, "_probe", lambda path: libllvm.Candidate(path, libllvm._version_in_name(path)))
    (machine / "libLLVM.so.99.1").touch()
    assert libllvm.packaged_library() is None and libllvm.best() == str(machine / "libLLVM.so.99.1")
    libllvm.candidates.cache_clear()
    assert packaged(machine) == libllvm.packaged_library() == libllvm.best()
    assert [candidate.version for candidate in libllvm.candidates()] == [(22, 1), (99, 1)]


@needs_llvm
def test_a_damaged_package_gives_way_to_the_system(machine):
    packaged(machine)
    real = os.path.realpath(os.environ["DRJIT_LIBLLVM_PATH"])
    (machine / "libLLVM.so").symlink_to(real)
    assert libllvm.best() == real
    assert "does not load" in libllvm.candidates()[0].problem


@pytest.mark.skipif(libllvm.packaged_library() is None, reason="the package karellen-llvm-core is not installed")
def test_a_package_whose_links_are_missing_renders(tmp_path):
    library = Path(libllvm.packaged_library())
    shutil.copytree(library.parent / libllvm._RUNTIME, tmp_path / libllvm._RUNTIME)
    shutil.copy(library, tmp_path)
    for link in (tmp_path / libllvm._RUNTIME).glob("*.so.1"):
        link.unlink()
    code = "from photonbeams.runtime.device import Float; import drjit; print(drjit.opaque(Float, 2) + 1)"
    assert libllvm._probe(str(tmp_path / library.name)).problem is None
    assert run(code, DRJIT_LIBLLVM_PATH=str(tmp_path / library.name), PHOTONBEAMS_DEVICE="cpu") == "[3]"


def test_a_machine_without_libllvm_is_told_what_to_install():
    code = """if True:
    from photonbeams.runtime import libllvm
    import sys, photonbeams, os
    libllvm.candidates = lambda: ()
    os.environ.pop("DRJIT_LIBLLVM_PATH", None)
    photonbeams.runtime.device.select("cpu")
    """
    sentence = run(code)
    assert "no working libLLVM was found" in sentence and "apt-get install libllvm19" in sentence


# -- Starting ------------------------------------------------------------------------------------------------------


@needs_llvm
def test_importing_photonbeams_names_a_library_and_imports_nothing_heavy():
    code = """if True:
    import os, sys, photonbeams
    print(os.environ["DRJIT_LIBLLVM_PATH"], *sorted({"drjit", "mitsuba", "numpy", "pxr"} & set(sys.modules)))
    """
    assert run(code) == libllvm.best()


def test_a_library_that_the_user_names_wins():
    code = "import os, photonbeams; print(os.environ['DRJIT_LIBLLVM_PATH'])"
    assert run(code, DRJIT_LIBLLVM_PATH="/mine/libLLVM.so") == "/mine/libLLVM.so"


def test_a_named_library_that_is_not_there_is_one_sentence():
    sentence = run(
        "from photonbeams.runtime.device import Float", DRJIT_LIBLLVM_PATH="/nowhere", PHOTONBEAMS_DEVICE="cpu"
    )
    assert "DRJIT_LIBLLVM_PATH names /nowhere, which Dr.Jit could not start" in sentence


def test_dr_jit_that_was_started_with_an_old_llvm_is_refused():
    code = """if True:
    import drjit
    drjit.detail.llvm_version = lambda: (15, 0, 7)
    from photonbeams.runtime import device
    device.select("cpu")
    """
    assert "expected a new process that imports photonbeams before Mitsuba" in run(code)


def test_dr_jit_that_does_not_load_is_one_sentence(tmp_path):
    # This is how the import fails if libatomic is missing.
    (tmp_path / "drjit.py").write_text("try:\n    raise ImportError('libatomic.so.1: gone')\nexcept ImportError: ext\n")
    sentence = run("from photonbeams.runtime.device import Float", PYTHONPATH=str(tmp_path), PHOTONBEAMS_DEVICE="cpu")
    assert "Dr.Jit does not load (libatomic.so.1: gone)" in sentence


def test_the_types_are_those_of_the_backend():
    import drjit as dr

    for name in device._ARRAY_TYPES:
        kind = getattr(device, name)
        assert dr.is_array_v(kind) and kind.__module__ == f"drjit.{device.backend()}.ad"


def test_mitsuba_has_the_variant_with_the_same_types():
    mi = device.mitsuba()
    assert mi.variant() == device.mitsuba_variant()
    assert mi.Float is device.Float
    assert device.mitsuba() is mi


@needs_llvm
def test_auto_follows_the_variant_that_mitsuba_already_has():
    code = """if True:
    import photonbeams, mitsuba
    mitsuba.set_variant("llvm_ad_rgb")
    photonbeams.runtime.device.cuda_problem = lambda: None
    print(photonbeams.runtime.device.backend())
    """
    assert run(code) == "llvm"


@needs_llvm
def test_the_environment_says_what_auto_means():
    code = """if True:
    from photonbeams.runtime import device
    device.cuda_problem = lambda: None
    device.select("auto")
    print(device.backend())
    """
    assert run(code, PHOTONBEAMS_DEVICE="cpu") == "llvm"


def test_another_device_than_the_running_one_is_refused(monkeypatch):
    other = {"llvm": "cuda", "cuda": "cpu"}[device.backend()]
    monkeypatch.setenv("PHOTONBEAMS_DEVICE", other)
    with pytest.raises(DeviceError, match="already started in this process"):
        device.select(other)
    device.select("auto")
    device.select({"llvm": "cpu", "cuda": "cuda"}[device.backend()])


@pytest.mark.skipif(device.cuda_problem() is None, reason="this machine has CUDA")
def test_cuda_on_a_machine_without_it_is_one_sentence():
    sentence = run("from photonbeams.runtime import device; device.select('cuda')")
    assert sentence.startswith("photonbeams.runtime.device.DeviceError: device is cuda, but")


def test_a_device_of_another_name_is_refused():
    with pytest.raises(DeviceError, match="device is 'gpu': expected auto, cpu or cuda"):
        device.select("gpu")


def test_an_unknown_attribute_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'Double'"):
        _ = device.Double


# -- What is running -----------------------------------------------------------------------------------------------


def test_threads_are_set_and_zero_means_all():
    import drjit as dr

    before = dr.thread_count()
    try:
        device.set_threads(1)
        assert dr.thread_count() == 1
        device.set_threads(0)
        assert dr.thread_count() == limits.processors()
    finally:
        device.set_threads(before)


def test_a_negative_number_of_threads_is_refused():
    with pytest.raises(DeviceError, match="threads is -1"):
        device.set_threads(-1)


def test_files_are_read_and_written_with_one_thread(tmp_path):
    """Mitsuba's OpenEXR files work with one thread. This runs in its own process, since a fault would wait forever."""
    script = (
        "import numpy as np; from photonbeams.runtime import device; mi = device.mitsuba(); device.set_threads(1)\n"
        "with device.helping_thread():\n"
        "    mi.Bitmap(np.full((64, 64, 3), 0.5, dtype=np.float32)).write('a.exr')\n"
        "    print(np.array(mi.Bitmap('a.exr')).mean())\n"
        "import drjit as dr; print(dr.thread_count())"
    )
    ran = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert ran.stdout.split() == ["0.5", "1"], ran.stderr


@pytest.mark.parametrize("before", ["mi.set_variant('llvm_ad_rgb'); import photonbeams", "import photonbeams"])
def test_an_old_library_that_drjit_took_by_itself_is_refused_before_a_kernel_aborts(before):
    script = (
        "import os, drjit, mitsuba as mi\n"
        "os.environ.pop('DRJIT_LIBLLVM_PATH', None); drjit.detail.llvm_version = lambda: (15, 0, 6)\n"
        f"{before}; mi.set_variant('scalar_rgb'); mi.set_variant('llvm_ad_rgb'); print('rendering')"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert ran.stdout == "" and "expected a new process that imports photonbeams before Mitsuba" in ran.stderr


def test_the_description_tells_what_is_there():
    backend, found = device.backend(), device.running()
    assert found["Backend"] == backend and limits.processors() >= 1 and limits.memory() > 1 << 28
    if backend == "llvm":
        assert int(found["LLVM"].partition(".")[0]) >= libllvm.OLDEST
        assert found["Vector width"] in ("unknown", "4", "8", "16") and int(found["Threads"]) >= 1


# -- The public names ----------------------------------------------------------------------------------------------


def test_every_public_name_is_there():
    import photonbeams
    from photonbeams import looks

    assert dir(photonbeams) == sorted(photonbeams.__all__)
    for module in (photonbeams, looks):
        for name in module.__all__:
            assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Beam'"):
        _ = photonbeams.Beam


def test_no_garbage_is_collected_within_contexts_and_it_is_as_before_after_them():
    assert gc.isenabled()
    with device.uncollected():
        with device.uncollected():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
