"""What the program runs on: libLLVM or CUDA, chosen before Dr.Jit is imported, and how it writes files."""
