"""carigs: photorealistic, controllable 3D caricature avatars from multi-view captures."""

from carigs.simd.kernel_cache import use_kernel_cache

use_kernel_cache()
