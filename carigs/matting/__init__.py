"""Mattes of footage: opacity and colours of a person, without the background that was there.

- `matted_frames`: all of it, for the frames of one camera; `given_mattes` for mattes of another program
- `one_person`: a coarse matte without other people
- `trimap`: the band around the outline of a coarse matte
- `background`: what is behind the person, from a plain wall or from the frames of a static camera
- `difference`: alpha from known colours, with its certainty; `colour_model`: colours of the person and of the rest
- `closed_form`: alpha in the band, by the matting Laplacian
- `steadiness`: mattes that do not flicker
- `neck_cut`, `cut_dataset`: mattes that end below the chin, and a copy of a dataset with them
- `foreground`: colours without the old background, and compositing on a grey
"""

from carigs.matting.foreground import composite
from carigs.matting.mattes import MattedFrame, given_mattes, matted_frames

__all__ = ["MattedFrame", "composite", "given_mattes", "matted_frames"]
