"""What commands print reaches any stream: one of another encoding, and one that the caller has closed."""

import io
import os
import subprocess
import sys

import pytest

from photonbeams import cli

STAGE = '#usda 1.0\ndef Camera "Straße_日本" {}\n'


@pytest.mark.parametrize(
    ("encoding", "shown"), [("ascii", b"/Stra\\xdfe_\\u65e5\\u672c\n"), ("cp1252", b"/Stra\xdfe_\\u65e5\\u672c\n")]
)
def test_names_that_a_stream_cannot_encode_are_escaped(encoding, shown, tmp_path, monkeypatch):
    (tmp_path / "a.usda").write_text(STAGE, encoding="utf-8")
    stream = io.TextIOWrapper(io.BytesIO(), encoding, newline="\n")
    monkeypatch.setattr(sys, "stdout", stream)
    with pytest.raises(SystemExit) as ended:
        cli.main(["render", str(tmp_path / "a.usda"), "--list-cameras"])
    stream.flush()
    assert (ended.value.code, stream.buffer.getvalue()) == (0, shown)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shell that closes streams")
def test_messages_for_a_closed_stream_go_nowhere():
    """Python has no object for a closed stream, and would print its messages on the other one."""
    command = [sys.executable, "-m", "photonbeams", "--unknown"]
    for closing, seen in (("2>&-", ""), (">&-", "Error: No such option: --unknown\n"), (">&- 2>&-", "")):
        found = subprocess.run(
            ["sh", "-c", f'exec "$@" {closing}', "sh", *command], capture_output=True, text=True, check=False
        )
        assert (found.returncode, found.stdout, found.stderr) == (2, "", seen)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has a full device")
def test_a_full_disk_loses_messages_but_no_results():
    command = [sys.executable, "-m", "photonbeams"]
    full = "standard output: No space left on device"
    for arguments, closing, code, seen in (
        ("--version", ">/dev/full", 1, f"Error: {full}\n"),
        ("--unknown", "2>/dev/full", 2, ""),
    ):
        found = subprocess.run(
            ["sh", "-c", f'exec "$@" {closing}', "sh", *command, arguments], capture_output=True, text=True, check=False
        )
        assert (found.returncode, found.stdout, found.stderr) == (code, "", seen)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shell that closes streams")
def test_messages_are_lost_but_no_render():
    """What reads them may have ended, as `head` does."""
    code = "import sys; from photonbeams import cli; cli._ready_streams(); sys.stderr.write('a'); sys.stderr.flush()"
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as gone:
        subprocess.run([sys.executable, "-c", code], stderr=gone, check=True)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shell that closes streams")
def test_no_file_takes_the_place_of_a_closed_stream():
    """What a compiled library prints would be written into that file."""
    code = (
        "import os, sys; from photonbeams import cli; cli._ready_streams(); "
        "sys.exit(not all(os.path.sameopenfile(each, os.open(os.devnull, os.O_WRONLY)) for each in (1, 2)))"
    )
    subprocess.run(["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", sys.executable, "-c", code], check=True)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps a folder that is used")
@pytest.mark.parametrize("command", ["render", "info", "dress", "doctor"])
def test_a_working_folder_that_was_deleted_gives_a_sentence(command, tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(SystemExit) as ended:
        cli.main([command] if command == "doctor" else [command, str(tmp_path / "a.usda")])
    assert (ended.value.code, capsys.readouterr().err) == (
        1,
        "Error: the working folder is not there: expected one that exists\n",
    )
