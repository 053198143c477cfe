"""Vectors and tuples as Numba values, compilation and cache of kernels, parallel loops, threads, and 3x3 matrices.

- `vectors`, `vector_math`, `memory`: vectors of sixteen floats, their functions, loads and stores
- `ir_values`: LLVM values with operators, in which the functions of vectors are written
- `tuples`, `matrix3`: functions on tuples; 3x3 matrices as tuples of nine numbers
- `kernels`, `linked_kernels`, `kernel_cache`: how kernels are compiled, and where they are kept
- `vector_loops`, `threads`: parallel loops over vectors, number of threads
"""

from carigs.simd.kernel_cache import use_kernel_cache

use_kernel_cache()  # before any module with kernels runs: each of them imports a module of this package
