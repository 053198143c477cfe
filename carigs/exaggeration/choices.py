"""What the types of the exaggeration's settings cannot say."""

from __future__ import annotations

import numpy as np

from carigs.errors import SettingsError
from carigs.settings import Exaggerate


def check_choices(settings: Exaggerate) -> None:
    """Raise `SettingsError` that names the first setting out of its range."""
    if not 0 < settings.curvature_floor < np.inf:
        raise SettingsError(f"exaggerate.curvature_floor={settings.curvature_floor:g} must be above 0")
    if not 0 < settings.path_error < np.inf:
        raise SettingsError(f"exaggerate.path_error={settings.path_error:g} must be above 0")
    for name in ("curvature_smoothing", "gap_stiffness", "cavity_stiffness"):
        if not 0 <= getattr(settings, name) < np.inf:
            raise SettingsError(f"exaggerate.{name}={getattr(settings, name):g} must not be negative")
    if settings.path_nodes == 1 or settings.path_nodes < 0:
        raise SettingsError(
            f"exaggerate.path_nodes={settings.path_nodes} must be 0, for as many as needed, or 2 or more"
        )
    for name, known in (
        ("region_constraint", ("soft", "exact", "literal")),
        ("curvature_source", ("subject", "ratio", "template")),
        ("blendshape_transfer", ("offset", "linear", "mixed")),
    ):
        if getattr(settings, name) not in known:
            raise SettingsError(f"exaggerate.{name}={getattr(settings, name)} is unknown; choose {', '.join(known)}")
