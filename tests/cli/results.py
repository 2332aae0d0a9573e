"""What tests of the command ask of its results."""


def fails(result, code, *parts, warnings=0):
    """Check for one sentence after so many warnings, and return it."""
    found, stdout, stderr = result
    lines = stderr.splitlines()
    assert (found, stdout, len(lines)) == (code, "", warnings + 1), stderr
    assert lines[-1].startswith("Error: ")
    assert all(line.startswith("Warning: ") for line in lines[:-1])
    for part in parts:
        assert part in lines[-1]
    return lines[-1]


def untouched(out):
    """Return whether the folder of outputs holds what it held before, and nothing else."""
    return [path.name for path in out.iterdir()] == ["old.exr"] and (out / "old.exr").read_bytes() == b"yesterday"
