"""The differentiable rasteriser of 2D Gaussian surfels, with CPU and CUDA backends."""
