"""The runtime: libLLVM or CUDA, chosen before Dr.Jit is imported; files and digests."""
