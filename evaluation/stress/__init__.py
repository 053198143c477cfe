"""Input that is broken in known ways: what comes out is right, or an error that names the element.

- `surface`: meshes for the exaggeration
"""
