"""The exaggeration of a head model's subject: whose curvature, which regions, which expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from carigs.exaggeration import Exaggerator, GammaPath, with_blendshapes
from carigs.head.model import HeadModel
from carigs.head.parameters import HeadParameters
from carigs.head.posing import motions
from carigs.head.teeth import skin
from carigs.settings import Exaggerate


def exaggerator(model: HeadModel, neutral: Float[np.ndarray, "v 3"], settings: Exaggerate) -> Exaggerator:
    """The solver for a subject's neutral head (metres), or for the model's mean face if the settings say so.

    Teeth are left out: `carigs.head.teeth` builds them anew.
    """
    v, f = skin(len(model.v_template), len(model.faces))
    shape = model.v_template if settings.curvature_source == "template" else neutral
    regions = {name: ids[ids < v] for name, ids in model.regions.items()}
    return Exaggerator(shape[:v], model.faces[:f], settings, regions=regions, mean=model.v_template[:v])


def caricature(
    model: HeadModel,
    neutral: Float[np.ndarray, "v 3"],
    settings: Exaggerate,
    parameters: Sequence[HeadParameters] = (),
) -> GammaPath:
    """The path of a subject's skin to `settings.gamma`: regions have levels of their own, and expressions go along.

    The motions that `parameters` use are changed as `settings.blendshape_transfer` says, the others stay natural.
    """
    solver = exaggerator(model, neutral, settings)
    solved = solver.path(settings.gamma, levels=settings.regions)
    if parameters:
        directions, columns = motions(model, parameters)
        directions = directions[:, : len(solver.vertices)]
        solved = with_blendshapes(solved, solver, directions, columns, settings.regions)
    return replace(solved, neutral=np.asarray(neutral, np.float64)[: len(solver.vertices)])
