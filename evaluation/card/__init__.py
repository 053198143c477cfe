"""The benchmark card of a study: every number with n, protocol, interval and the reason where it is missing.

- `card`: the card, and its JSON
- `measures`: what costs mean: surfels, bytes, seconds
- `costs`: time and memory of stages from the records of their jobs
- `provenance`: machine, versions, commit, seeds
- `document`: the card as text and tables

Nothing is re-exported: `card` imports pandas.
"""
