"""The light of a capture: fitted to its frames, with shadow maps, and shading that follows the surface."""
