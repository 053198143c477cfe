"""carigs: photorealistic, controllable 3D caricature avatars from multi-view captures."""
