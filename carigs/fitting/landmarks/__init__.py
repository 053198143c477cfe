"""Landmarks of faces in images: where they come from, what their numbers mean, and the fit of a head to them.

- `files`, `providers`: what detectors write; `embedding`: the landmarks on a head model
- `fit`: triangulation, rigid alignment, reprojection error
- `convention`: refuses landmarks in another unit, origin or order, by `image_map`, `mistakes` and `orders`
"""
