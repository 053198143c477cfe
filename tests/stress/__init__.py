"""Stress tests: input that breaks numerics, broken files, and invariants on real heads.

- `case`: cases, their outcomes (right, typed error, wrong), and the command line of a suite
- `summary`: the outcomes of all suites in one table
- `surface`: broken meshes; `heads`: invariants of the exaggeration on real heads and random people
- `raster`: the triangle rasterizer; `mesh_reference`: rays against triangles in float64; `meshes`: small meshes
- `targets`: warped frames and their mask flags
- `rig`: motions of triangles; `skinning`, `posing`: its cases of surfels and joints; `deformations`: deformed meshes
- `rasterizer`: the surfel rasterizer; `surfel_scenes`, `surfel_reference`, `surfel_gradients`: its input and reference
- `metrics`: metrics of images, regions and embeddings, and intervals
- `hostile_files`, `hostile_readers`, `hostile_cases`: broken and hostile files
- `captures`, `capture_changes`: damaged and odd captures
"""
