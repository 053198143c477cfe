"""Vectors as Numba values, the compilation of kernels and their cache, threads, and 3x3 matrices."""
