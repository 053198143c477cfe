"""What is changed in images and mattes when they are read, as the fields of a frame say.

- `colour_gains`: factors on the light of an image
- `halo`: an old background that shows at the outline of an image
- `known_background`: a matte that is made anew near its outline
"""
