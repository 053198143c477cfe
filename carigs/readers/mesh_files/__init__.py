"""Readers of meshes.

- `meshes`: all formats by one function
- `ply`: .ply files; `ply_header`: their header
- `obj`, `off`: the vertices and faces of .obj and .off files
- `glb`: the triangles of glTF; `gltf_data`: its numbers; `gltf_extensions`: which extensions a file may require
- `polygons`: faces with more than three corners, cut into triangles; `coincident`: those that a file holds twice
"""
