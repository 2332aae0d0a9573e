"""The command, called in the process of the tests, and a folder for what it writes."""

import pytest

from photonbeams import cli


@pytest.fixture
def call(capfd):
    """Call the command in this process: its exit code, and what it printed to standard output and error."""

    def called(command, *arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main([command, *map(str, arguments)])
        return (stop.value.code, *capfd.readouterr())

    return called


@pytest.fixture
def render(call):
    """Call `photonbeams render`."""
    return lambda *arguments: call("render", *arguments)


@pytest.fixture
def out(tmp_path):
    """Return the folder of outputs, in which a file of yesterday lies."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "old.exr").write_bytes(b"yesterday")
    return folder
