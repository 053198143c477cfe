"""Stress tests with a bound for every case.

- `surface`: meshes broken in known ways: the result is correct, or an error names the element
- `heads`: invariants of the exaggeration on real heads and random people
"""
