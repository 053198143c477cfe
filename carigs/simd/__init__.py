"""Vectors and tuples as Numba values, compilation and cache of kernels, parallel loops, threads, and 3x3 matrices.

- `vectors`, `vector_math`, `reductions`: vectors of sixteen floats, their functions, sums over their lanes
- `memory`, `records`: loads and stores of vectors, and of sixteen records at a time
- `ir_values`: LLVM values with operators, in which the functions of vectors are written
- `tuples`, `matrix3`: functions on tuples; 3x3 matrices as tuples of nine numbers
- `kernels`, `linked_kernels`: how kernels are compiled
- `kernel_cache`, `kernel_files`: where compiled kernels are kept, and how
- `vector_loops`, `threads`, `forks`: parallel loops over vectors, number of threads, also in forked processes
"""

from carigs.simd.kernel_cache import sources_digest

sources_digest()  # now, when the sources are imported: a later edit changes no kernel of this process
