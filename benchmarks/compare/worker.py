"""A process that renders scenes by one tree's code: `python -m benchmarks.compare.worker`, with its src/ in PYTHONPATH.

The first line that it writes says where `photonbeams` comes from. Then each line that it reads is a `Request` in JSON,
and each line that it writes a `Reply`. All else that it or a library prints goes to the standard error.

Each render opens its scene anew, which is not timed: nothing is taken over from another but the process' kernels.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import drjit as dr
import mitsuba as mi
import numpy as np

import photonbeams as pb
from tests.helpers.kernels import is_new

from .protocol import Reply, Request
from .scenes import SCENES

# Where Linux tells of a process' memory and resets its peak; 5 is the command that does so (proc(5)).
_STATUS = Path("/proc/self/status")
_RESET = Path("/proc/self/clear_refs")
_RESET_PEAK = "5"


def main() -> None:
    """Answer requests until the input ends."""
    replies = _private_output()
    mi.set_variant("llvm_ad_rgb")
    _write(replies, {"file": pb.__file__, "scenes": list(SCENES)})
    for line in sys.stdin:
        request = Request(**json.loads(line))
        try:
            reply = rendered(request)
        except Exception as error:  # an older tree may lack what a scene needs
            reply = Reply(error=f"{type(error).__name__}: {' '.join(str(error).split())}")
        _write(replies, asdict(reply))


def _private_output() -> TextIO:
    """Return the standard output, and have everybody else print to the standard error, libraries in C++ too."""
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return output


def _write(output: TextIO, message: dict[str, Any]) -> None:
    output.write(json.dumps(message) + "\n")
    output.flush()


def rendered(request: Request) -> Reply:
    """Render a scene once; write its picture, and return what it cost."""
    render = SCENES[request.scene].open()
    gc.collect()
    dr.flush_malloc_cache()  # or memory of an earlier scene would be used again, and the peak would be too low
    before = _reset_peak()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, request.counts):
        dr.kernel_history_clear()
        begin = os.times()
        layers = render(request.seed)
        dr.sync_thread()
        end = os.times()
        history = dr.kernel_history() if request.counts else []
    peak = _memory("VmHWM")
    np.save(request.file, np.float32(layers["rgba"][..., :3]))
    return Reply(
        digests={name: _digest(layer) for name, layer in layers.items()},
        seconds=end.user + end.system - begin.user - begin.system,
        memory=None if before is None or peak is None else peak - before,
        launches=len(history),
        kernels=len({entry["hash"] for entry in history if is_new(entry)}),
    )


def _digest(layer: Any) -> str:
    """Return a digest of a layer's size and bits."""
    layer = np.ascontiguousarray(layer)
    return hashlib.sha256(f"{layer.shape} {layer.dtype}".encode() + layer.tobytes()).hexdigest()


def _reset_peak() -> int | None:
    """Return the process' memory in bytes, from which its peak is counted from now on; None: the system cannot."""
    try:
        _RESET.write_text(_RESET_PEAK)
    except OSError:
        return None
    return _memory("VmRSS")


def _memory(name: str) -> int | None:
    """Return a number of bytes from the process' status, or None."""
    try:
        lines = _STATUS.read_text().splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(f"{name}:")), None)


if __name__ == "__main__":
    main()
