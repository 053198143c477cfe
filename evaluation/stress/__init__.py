"""Bars that must hold, case by case.

- `surface`: meshes that are broken in known ways: what comes out is right, or an error that names the element
- `heads`: what the exaggeration must keep of real heads and random people
"""
