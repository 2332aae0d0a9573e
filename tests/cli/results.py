"""Checks of the command's results."""


def fails(result, code, *parts, warnings=0):
    """Assert that a call fails with a one-line error message after so many warnings, and return the message."""
    found, stdout, stderr = result
    lines = stderr.splitlines()
    assert (found, stdout, len(lines)) == (code, "", warnings + 1), stderr
    assert lines[-1].startswith("Error: ")
    assert all(line.startswith("Warning: ") for line in lines[:-1])
    for part in parts:
        assert part in lines[-1]
    return lines[-1]


def untouched(out):
    """Return whether the output folder holds only its old file, unchanged."""
    return [path.name for path in out.iterdir()] == ["old.exr"] and (out / "old.exr").read_bytes() == b"yesterday"
