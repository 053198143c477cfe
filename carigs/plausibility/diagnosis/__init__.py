"""Diagnosis of a capture: which of the usual mistakes, once undone, makes the posed mesh fit the images?

- `diagnose`: tries the mistakes on a scene, and names the one that mends it
- `read_scene` -> `Scene`: a few frames at a low resolution
- `reproject` -> `Reprojection`: misfit of silhouettes and of colours
- `HYPOTHESES`: the mistakes
"""

from carigs.plausibility.diagnosis.hypotheses import HYPOTHESES, Hypothesis
from carigs.plausibility.diagnosis.reprojection import Reprojection, reproject
from carigs.plausibility.diagnosis.scene import Scene, read_scene
from carigs.plausibility.diagnosis.trial import Diagnosis, diagnose

__all__ = ["HYPOTHESES", "Diagnosis", "Hypothesis", "Reprojection", "Scene", "diagnose", "read_scene", "reproject"]
