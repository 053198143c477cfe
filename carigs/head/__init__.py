"""The head model: FLAME-format files, tracked parameters, posing.

- `HeadModel`: the arrays of a model file; `HeadModel.load` reads .npz and FLAME's .pkl
- `HeadParameters`: one tracked frame; reads and writes the GaussianAvatars npz layout
- `exaggerator`, `caricature`: the solver and the path S_gamma of a subject
- `neutral`, `pose`: vertices without and with expression, joints and translation
- `motions`: the directions that a performance moves in
- `carigs.head.teeth`: the teeth that FLAME gets, on the natural head and on its caricatures
"""

from carigs.head.caricature import caricature, exaggerator
from carigs.head.model import HeadModel
from carigs.head.parameters import HeadParameters
from carigs.head.posing import motions, neutral, pose

__all__ = ["HeadModel", "HeadParameters", "caricature", "exaggerator", "motions", "neutral", "pose"]
