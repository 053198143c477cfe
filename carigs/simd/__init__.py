"""Vector types for Numba kernels, compilation and cache of kernels, threads, and 3x3 matrices."""
