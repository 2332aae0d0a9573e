"""The kernels that a call compiles; a second frame should reuse those of the first."""

import re

import drjit as dr

#: What differs between two kernels that are one up to constants: their names, and whole numbers.
_CONSTANTS = re.compile(r"drjit_[0-9a-f]+|\b(?:i8|i32|i64) -?\d+\b")


def compiled(function, *arguments):
    """Return the kernels that a call compiles or loads from the disk cache; assert that it launches at least one."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        function(*arguments)
        kernels = [each for each in dr.kernel_history() if each["type"].name == "JIT"]
    assert kernels
    return [each for each in kernels if is_new(each)]


def is_new(kernel):
    """Return whether a launch is the first of its kernel in this process, which compiled it or read it from a file."""
    return kernel["type"].name == "JIT" and (kernel["cache_disk"] or not kernel["cache_hit"])


def without_constants(kernel):
    """Return the code of a kernel without its whole numbers, by which kernels that depend on numbers are one."""
    return _CONSTANTS.sub("#", kernel["ir"].getvalue())
