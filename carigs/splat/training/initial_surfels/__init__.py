"""Surfels that a training starts with: on triangles, inside the hair, inside the mouth."""
