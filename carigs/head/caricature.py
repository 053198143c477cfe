"""The exaggeration of a head model's subject: whose curvature, and which regions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.head.model import HeadModel
from carigs.settings import Exaggerate
from carigs.surface import Exaggerator, GammaPath


def exaggerator(model: HeadModel, neutral: Float[np.ndarray, "v 3"], settings: Exaggerate) -> Exaggerator:
    """The solver for a subject's neutral head (metres), or for the model's mean face if the settings say so."""
    shape = model.v_template if settings.individual == "template" else neutral
    return Exaggerator(shape, model.faces, settings, regions=model.regions, mean=model.v_template)


def caricature(model: HeadModel, neutral: Float[np.ndarray, "v 3"], settings: Exaggerate) -> GammaPath:
    """The subject's path to `settings.gamma`, with the regions that have levels of their own."""
    path = exaggerator(model, neutral, settings).path(settings.gamma, levels=settings.regions)
    return GammaPath(path.levels, path.displacements, path.faces, np.asarray(neutral, np.float64), path.report)
