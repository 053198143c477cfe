"""Files of the fixture `scene`, and the records of the stage `metrics` for it."""

import json

from carigs.settings import Metrics
from carigs.stages.metrics import metrics
from evaluation.tables.summary import read_metrics


def shown(scene, level=0.25):
    """Folder of the rendered frames of a level."""
    return scene["frames"] / f"level={level:g}"


def index(scene):
    return shown(scene) / "frames.json"


def measured(scene, lpips=(), **settings):
    metrics(Metrics(lpips=lpips, **settings), **scene)
    return list(read_metrics([scene["records"]]).itertuples())


def edit(file, change):
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
