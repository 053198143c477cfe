"""Viewers of an avatar.

- `html`: `write_html`, an avatar as one HTML file that needs neither a server nor a network

Modules are imported directly: this package imports nothing, so that no module loads more than it needs.
"""
