"""Fixtures that call the command in the process of the tests, and a folder for its output."""

import pytest

from photonbeams import cli


@pytest.fixture
def call(capfd):
    """Return a function that calls the command and returns its exit code, its standard output and its error output."""

    def called(command, *arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main([command, *map(str, arguments)])
        return (stop.value.code, *capfd.readouterr())

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
