"""What our parts cost and how accurate they are, as tidy rows.

- `measurements`: the rows, and their CSV file
- `surface`: the exaggeration: time against error
"""
