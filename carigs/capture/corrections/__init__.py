"""What is changed in images when they are read, as the fields of a frame say.

- `colour_gains`: factors on the light of an image
"""
