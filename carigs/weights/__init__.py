"""Weights of networks that others have trained: which there are, where they are searched, and how they are fetched.

- `registry`: the entries of `registry.toml`
- `search`: places on this machine, with the command that fetches what is missing
- `downloads`, `wheels`: files from the web, and files inside Python packages; `checksums`
"""
