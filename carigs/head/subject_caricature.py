"""The caricature of a head model's subject: choice of the curvature, regions, transfer of the blendshapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from carigs.exaggeration.blendshape_transfer import transfer_blendshapes
from carigs.exaggeration.exaggerator import Exaggerator
from carigs.exaggeration.fade import faded_path
from carigs.exaggeration.gamma_path import GammaPath
from carigs.head.model import HeadModel
from carigs.head.neck_border import neck_border
from carigs.head.parameters import HeadParameters
from carigs.head.posing import active_blendshapes
from carigs.head.teeth import skin_counts
from carigs.settings import Exaggerate


def subject_exaggerator(model: HeadModel, neutral: Float[np.ndarray, "v 3"], settings: Exaggerate) -> Exaggerator:
    """Make the solver of a subject's head, or of the model's mean face if `settings.curvature_source` is `template`.

    Teeth are left out; `carigs.head.teeth.add_teeth` builds those of the caricature.

    Args:
        model: Head model with the regions.
        neutral: Vertices of the subject without expression and pose, in metres.
        settings: Options of the exaggeration.

    Returns:
        The factorised solver of the skin.

    Raises:
        MeshError: If the mesh cannot be solved on.
        SettingsError: If a setting is out of range.
    """
    v, f = skin_counts(len(model.v_template), len(model.faces))
    vertices = model.v_template if settings.curvature_source == "template" else neutral
    regions = {name: ids[ids < v] for name, ids in model.regions.items()}
    return Exaggerator(vertices[:v], model.faces[:f], settings, regions=regions, mean_face=model.v_template[:v])


def subject_gamma_path(
    model: HeadModel,
    neutral: Float[np.ndarray, "v 3"],
    settings: Exaggerate,
    parameters: Sequence[HeadParameters] = (),
) -> GammaPath:
    """Solve the path of a subject's skin to `settings.gamma`, with the regions and blendshapes of the head model.

    Args:
        model: Head model with regions and blendshapes.
        neutral: Vertices of the subject without expression and pose, in metres.
        settings: Options of the exaggeration, among them the levels of regions.
        parameters: Frames whose blendshapes are transferred to the caricature; the others keep their natural form.

    Returns:
        The path, without teeth.

    Raises:
        MeshError: If the mesh cannot be solved on.
        SettingsError: If a setting is out of range or a region is unknown.
    """
    exaggerator = subject_exaggerator(model, neutral, settings)
    path = exaggerator.path(settings.gamma, levels=settings.regions)
    v = len(exaggerator.vertices)
    if parameters:
        blendshapes, columns = active_blendshapes(model, parameters)
        path = transfer_blendshapes(path, exaggerator, blendshapes[:, :v], columns, settings.regions)
    path = replace(path, neutral=np.asarray(neutral, np.float64)[:v])
    border = neck_border(model, neutral) if settings.border_fade > 0 else None
    if border is None:
        return path
    fixed = np.union1d(border.vertices, model.faces[border.carriers])
    return faded_path(path, fixed[fixed < v], settings.border_fade)
