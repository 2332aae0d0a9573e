"""The kernels that a call compiles; a second frame should reuse those of the first."""

import drjit as dr


def compiled(function, *arguments):
    """Return the kernels that a call compiles or loads from the disk cache; assert that it launches at least one."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        function(*arguments)
        kernels = [each for each in dr.kernel_history() if each["type"].name == "JIT"]
    assert kernels
    return [each for each in kernels if each["cache_disk"] or not each["cache_hit"]]
