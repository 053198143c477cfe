"""Figures: every image in its place, the blend error of a known path, the files of the stage."""

import csv
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model, write_ball

from carigs.capture import Camera, Capture, read_dataset
from carigs.capture.camera import look_at
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.images import read_rgb, write_png
from carigs.errors import CarigsWarning
from carigs.exaggeration import Exaggerator, GammaPath, straight_path
from carigs.gtstar import warp
from carigs.head import neutral
from carigs.settings import DEFAULT_MASK_FLAGS, Exaggerate, Figures, Gtstar
from carigs.stages.figures import figures
from evaluation.figures import strips
from evaluation.figures.blend_error import BlendError, blend_errors
from evaluation.figures.misregistration import MAX_MASKED, REGIONS, misregistrations
from evaluation.figures.region_window import PROPORTIONS, region_window
from evaluation.figures.sheet import write_sheet
from evaluation.figures.study_images import IMAGE_HEIGHT, StudyImages
from evaluation.tables.csv_files import write_csv


def test_every_image_of_a_sheet_is_in_its_row_and_column(tmp_path):
    def flat(i, j):
        return np.full((30, 20, 3), [i / 2, j / 3, 1.0])

    images = [[flat(i, j) for j in range(3)] for i in range(2)]
    images[1][2] = None
    write_sheet(tmp_path / "a.png", images, rows=["x", "y"], columns=list("abc"), title="t", height=60)
    sheet = read_rgb(tmp_path / "a.png")
    blue = (sheet[:, :, 2] > 0.99) & (sheet[:, :, :2].min(axis=2) < 0.99)
    found = {}
    for i in range(2):
        for j in range(3):
            where = blue & (np.abs(sheet[:, :, :2] - [i / 2, j / 3]).max(axis=2) < 0.01)
            found[i, j] = (where.sum(), *np.argwhere(where).mean(axis=0)) if where.any() else None
    assert found.pop((1, 2)) is None
    for (i, j), (area, y, x) in found.items():
        assert area == pytest.approx(60 * 40, rel=0.05)
        assert y - found[0, 0][1] == pytest.approx(60 * i, abs=1.5)
        assert x - found[0, 0][2] == pytest.approx(40 * j, abs=1.5)


@pytest.fixture(scope="module")
def quadratic():
    """S_gamma = S + gamma (1 + gamma) d: three nodes reproduce it, a straight line does not."""
    generator = np.random.default_rng(0)
    shape, direction = generator.normal(size=(50, 3)), generator.normal(size=(50, 3))
    levels = np.array([0, 0.125, 0.25])
    displacements = ((levels * (1 + levels))[:, None, None] * direction).astype(np.float32)
    path = GammaPath(levels, displacements, np.array([[0, 1, 2]]), shape)
    return path, direction, lambda level: level * (1 + level) * direction


def test_the_blend_error_of_a_quadratic_path_is_the_product_of_the_distances_to_its_ends(quadratic):
    path, direction, exact = quadratic
    diagonal = np.linalg.norm(np.ptp(path.neutral, axis=0))
    for error in blend_errors(path, exact, 11):
        wanted = error.level * (0.25 - error.level) * np.linalg.norm(direction, axis=1) / diagonal
        assert error.blend_largest == pytest.approx(wanted.max(), abs=1e-12)
        assert error.blend_rms == pytest.approx(np.sqrt((wanted**2).mean()), abs=1e-12)
        assert error.path_largest < 1e-7 and error.path_rms <= error.path_largest


def test_the_blend_error_does_not_depend_on_the_unit(quadratic):
    path, _, exact = quadratic
    scaled = GammaPath(path.levels, 1000 * path.displacements, path.faces, 1000 * path.neutral)
    metres, millimetres = blend_errors(path, exact, 5), blend_errors(scaled, lambda level: 1000 * exact(level), 5)
    np.testing.assert_allclose([e[:3] for e in metres], [e[:3] for e in millimetres])


def test_blend_errors_are_written_as_numbers(quadratic, tmp_path):
    errors = blend_errors(*quadratic[::2], 5)
    write_csv(tmp_path / "e.csv", errors, BlendError)
    with (tmp_path / "e.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    np.testing.assert_allclose([float(line["blend_rms"]) for line in lines], [e.blend_rms for e in errors], rtol=1e-5)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Keywords of the stage: two variants at two levels, of which one has a truth."""
    folder = tmp_path_factory.mktemp("study")
    read_dataset(write_ball(folder / "ball"), folder / "ball/head_model.npz").save(folder / "capture.json")
    subject = Capture.load(folder / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    settings = Exaggerate(limit_cavities=False)
    Exaggerator(shape, subject.model.faces, settings).path(0.25).save(folder / "path.npz")
    straight_path(shape, subject.model.faces, 0.1 * shape, 0.25).save(folder / "given.npz")
    test = subject.split("test")
    keywords = {"frames": [], "variants": ["alternating", "surfhead"], "truths": [], "levels": [0.0, 0.25]}
    for i, variant in enumerate(keywords["variants"]):
        keywords["frames"].append(folder / variant)
        for level in keywords["levels"]:
            place = folder / f"{variant}/level={level:g}"
            (place / "test").mkdir(parents=True)
            entries = []
            for frame in test:
                write_png(place / f"test/{frame.name}.png", np.full((48, 40, 3), i / 2 + level))
                entries.append({"protocol": "test", "timestep": frame.timestep, "camera": frame.camera,
                                "file": f"test/{frame.name}.png", "order": len(entries)})  # fmt: skip
            (place / "frames.json").write_text(json.dumps(entries))
    for level, reason in ((0.0, None), (0.25, "unknown")):
        place = folder / f"truth/{level}"
        (place / "frames").mkdir(parents=True)
        entries = []
        for frame in () if reason else test:
            write_png(place / f"frames/{frame.name}.png", subject.image(frame))
            write_png(place / f"frames/{frame.name}_mask.png", subject.mask(frame))
            entries.append({"timestep": frame.timestep, "camera": frame.camera,
                            "image": f"{frame.name}.png", "mask": f"{frame.name}_mask.png"})  # fmt: skip
        (place / "truth.json").write_text(json.dumps({"level": level, "reason": reason, "frames": entries}))
        keywords["truths"].append(place / "truth.json")
    others = {"avatar": None, "gtstar": {}, "mask_flags": DEFAULT_MASK_FLAGS}
    return folder, {**keywords, "capture": folder / "capture.json", **others}


def left_out(folder):
    """Reasons by figure."""
    return dict(line.split(": ", 1) for line in (folder / "left_out.txt").read_text().splitlines())


def test_a_given_caricature_gets_its_strips_and_says_why_there_is_nothing_solved(study):
    folder, keywords = study
    figures(Figures(), **keywords, path=folder / "given.npz", folder=folder / "given")
    reasons = left_out(folder / "given")
    drawn = {file.stem for file in (folder / "given").glob("*.png")}
    assert drawn == {"gamma_strip_alternating", "gamma_strip_surfhead", "ablation", "renderings", "hair"}
    assert set(reasons) == {"alternation", "mouth", "hair_mask", "local_edits", "blend_error", "misregistration"}
    assert "gtstar_only" in reasons["alternation"] and "no_hair_mask" in reasons["hair_mask"]
    assert "from a file" in reasons["blend_error"]
    # alternating | surfhead | truth against alternating | truth | error
    assert (
        read_rgb(folder / "given/ablation.png").shape[1] == read_rgb(folder / "given/gamma_strip_surfhead.png").shape[1]
    )


def test_the_hair_is_shown_at_both_levels_without_a_column_for_an_unknown_truth(study):
    """Renderings are black at level 0 and dark grey at 0.25, whose truth is not known."""
    folder, keywords = study
    figures(Figures(), **keywords, path=folder / "given.npz", folder=folder / "hair")
    sheet = read_rgb(folder / "hair/hair.png")
    subject = Capture.load(folder / "capture.json")
    truths = {level: read_ground_truth(file) for level, file in zip((0.0, 0.25), keywords["truths"], strict=True)}
    views = StudyImages(subject, {"alternating": folder / "alternating"}, truths, Figures()).views
    assert len(views) == 3
    cells = len(views) * IMAGE_HEIGHT * round(IMAGE_HEIGHT * PROPORTIONS)
    grey, black = ((np.abs(sheet - value).max(axis=2) < 0.003) for value in (0.25, 0.0))
    assert grey.sum() == pytest.approx(cells, rel=0.05) and black.sum() == pytest.approx(cells, rel=0.1)
    columns = [np.nonzero(shown)[1].mean() for shown in (black, grey)]
    assert columns[1] - columns[0] == pytest.approx(
        2 * IMAGE_HEIGHT * PROPORTIONS, rel=0.1
    )  # the truth at level 0 is between


def test_the_open_mouth_is_looked_for_among_rendered_frames(study, tmp_path, monkeypatch):
    """A study may render some test timesteps only; here the mouth is open wider at those that it leaves out."""
    folder, keywords = study
    subject = Capture.load(folder / "capture.json")
    shown = subject.split("test")[0]
    subject = replace(subject, frames=tuple(replace(frame, split="test") for frame in subject.frames))
    assert len({frame.timestep for frame in subject.split("test")}) > 1
    monkeypatch.setattr(strips, "lip_line", lambda *_: True)
    monkeypatch.setattr(Capture, "parameters", lambda _, timestep: timestep)
    monkeypatch.setattr(strips, "pose", lambda _, timestep: timestep)
    monkeypatch.setattr(strips, "lip_gap", lambda _, timestep: float(timestep != shown.timestep))
    monkeypatch.setattr(strips, "_window", lambda *_: (slice(0, 24), slice(0, 32)))
    truths = {level: read_ground_truth(file) for level, file in zip((0.0, 0.25), keywords["truths"], strict=True)}
    settings = Figures(timestep=shown.timestep, camera=shown.camera)
    images = StudyImages(subject, {"alternating": folder / "alternating"}, truths, settings, height=96)
    assert strips.mouth(tmp_path / "mouth.png", images, GammaPath.load(folder / "given.npz")) is None
    assert (tmp_path / "mouth.png").exists()


def test_figures_are_the_same_bytes_again(study):
    folder, keywords = study
    for name in ("a", "b"):
        figures(Figures(), **keywords, path=folder / "given.npz", folder=folder / name)
    for file in (folder / "a").iterdir():
        assert file.read_bytes() == (folder / "b" / file.name).read_bytes()


@pytest.mark.slow
def test_a_solved_path_gets_its_blend_error_unless_solving_again_gives_another(study):
    folder, keywords = study
    solved = GammaPath.load(folder / "path.npz")
    few = Figures()
    told = {**solved.report, "settings": {"limit_cavities": False}}
    GammaPath(solved.levels, solved.displacements, solved.faces, solved.neutral, told).save(folder / "told.npz")
    for name in ("told", "told_again"):
        figures(few, **keywords, path=folder / "told.npz", folder=folder / name)
    assert "blend_error" not in left_out(folder / "told")
    for ending in ("png", "pdf", "csv"):
        first, second = (folder / name / f"blend_error.{ending}" for name in ("told", "told_again"))
        assert first.read_bytes() == second.read_bytes()
    wrong = {**solved.report, "settings": {"limit_cavities": False, "curvature_floor": 3.0}}
    GammaPath(solved.levels, solved.displacements, solved.faces, solved.neutral, wrong).save(folder / "wrong.npz")
    figures(few, **keywords, path=folder / "wrong.npz", folder=folder / "wrong")
    assert "solving again gives another" in left_out(folder / "wrong")["blend_error"]


def hair_masked(records):
    return next(record.masked for record in records if record.region == "hair")


def test_misregistration_follows_the_settings_of_the_study(study, monkeypatch):
    """Pixels are marked by the flags of the settings, on the truth that the frames themselves are at level 0."""
    folder, keywords = study
    subject, path = Capture.load(keywords["capture"]), GammaPath.load(folder / "given.npz")
    truths = {0.25: read_ground_truth(keywords["truths"][0])}  # natural frames, hence wrong at 0.25
    monkeypatch.setattr(warp, "MAX_STRETCH", 1.0)
    marked = {}
    for flags in (DEFAULT_MASK_FLAGS, ("stretched",)):
        records = list(misregistrations(subject, path, truths, Gtstar(), flags))
        assert {record.level for record in records} == {0.25} and {r.region for r in records} <= set(REGIONS)
        marked[flags] = {record.region: record.marked for record in records}
        assert flags != DEFAULT_MASK_FLAGS or hair_masked(records) > MAX_MASKED
    assert marked[DEFAULT_MASK_FLAGS] != marked["stretched",]
    monkeypatch.setattr(warp, "MAX_STRETCH", 6.0)
    narrow = list(misregistrations(subject, path, truths, Gtstar(), ("stretched",)))
    assert hair_masked(narrow) < MAX_MASKED
    assert sum(record.marked for record in narrow) < sum(marked["stretched",].values())


@pytest.mark.parametrize(
    ("named", "reason"),
    [
        ({"camera": 99}, "figures.camera=99: no such test frame; there are cameras 0, 1, 2 and timesteps 3"),
        ({"timestep": 0}, "figures.timestep=0: no such test frame; there are cameras 0, 1, 2 and timesteps 3"),
        ({"camera": 1, "timestep": 9}, "figures.camera=1, figures.timestep=9: no such test frame"),
    ],
)
def test_figures_of_a_frame_that_does_not_exist_are_left_out(study, tmp_path, named, reason):
    folder, keywords = study
    with pytest.warns(CarigsWarning, match=re.escape(reason)):
        figures(Figures(**named), **keywords, path=folder / "given.npz", folder=tmp_path / "none")
    reasons = left_out(tmp_path / "none")
    for name in ("ablation", "gamma_strip_surfhead", "renderings", "hair"):
        assert reasons[name].startswith(reason)
    assert not list((tmp_path / "none").glob("*.png"))


def test_a_frame_that_some_variant_lacks_is_not_shown(study, tmp_path):
    folder, keywords = study
    shutil.copytree(folder / "surfhead", tmp_path / "surfhead")
    index = tmp_path / "surfhead/level=0.25/frames.json"
    rendered = {name: tmp_path / "surfhead" if name == "surfhead" else folder / name for name in keywords["variants"]}
    subject = Capture.load(folder / "capture.json")
    truths = {level: read_ground_truth(file) for level, file in zip((0.0, 0.25), keywords["truths"], strict=True)}
    entries = json.loads(index.read_text())
    for kept, frame in (({0, 1, 2}, (3, 1)), ({0, 2}, (3, 0)), ({2}, (3, 2))):
        index.write_text(json.dumps([entry for entry in entries if entry["camera"] in kept]))
        images = StudyImages(subject, rendered, truths, Figures(), 96)
        assert images.frame == frame and {camera for _, camera in images.views} == kept
    index.write_text("[]")
    assert "no test frame is rendered" in StudyImages(subject, rendered, truths, Figures(), 96).problem


class CodedImages(StudyImages):
    """Images whose only pixel says what they show: variant, level, camera."""

    def rendered(self, variant, level, frame=None):
        return np.array([[[variant, level, (frame or self.frame)[1]]]], dtype=object)

    def rendered_frames(self, variant, level):
        return {(frame.timestep, frame.camera) for frame in self.subject.split("test")}

    def true(self, level, frame=None):
        return self.rendered("truth", level, frame)


@pytest.fixture
def sheets(monkeypatch):
    """Images of the sheets that are written, as (variant, level, camera), by row and column."""
    written = []

    def write(file, images, *, rows, columns, **options):
        written.append({(row, column): tuple(image.ravel()) for row, line in zip(rows, images, strict=True)
                        for column, image in zip(columns, line, strict=True)})  # fmt: skip

    monkeypatch.setattr(strips, "write_sheet", write)
    return written


def coded(study, variants):
    subject = Capture.load(study[1]["capture"])
    return CodedImages(subject, dict.fromkeys(variants), dict.fromkeys((0.0, 0.1, 0.25)), Figures(camera=1), 96)


def test_every_image_of_a_comparison_is_the_one_of_its_variant_level_and_view(study, sheets, tmp_path):
    images = coded(study, ["alternating", "surfhead", "gtstar_only"])
    assert strips.renderings(tmp_path / "r.png", images) is None
    assert strips.alternation(tmp_path / "a.png", images) is None
    renderings, alternation = sheets
    cameras = [camera for _, camera in images.views]
    assert cameras[0] == 1 and len(set(cameras)) == len(cameras) > 1
    for camera in cameras:
        row = f"camera {camera}"
        assert renderings[row, "surfhead, γ = 0.25"] == ("surfhead", 0.25, camera)
        assert renderings[row, "truth, γ = 0.25"] == ("truth", 0.25, camera)
        for level in (0, 0.1, 0.25):
            assert renderings[row, f"γ = {level:g}"] == ("alternating", level, camera)
    names = {"original only": "surfhead", "GT* only": "gtstar_only", "alternating": "alternating", "truth": "truth"}
    assert alternation == {
        (name, f"γ = {level:g}"): (variant, level, 1) for name, variant in names.items() for level in (0, 0.1, 0.25)
    }


def test_edited_avatars_stand_between_what_they_start_from_and_the_method(study, sheets, tmp_path, monkeypatch):
    images = coded(study, ["alternating", "drawn", "surfhead", "painted"])
    monkeypatch.setattr(CodedImages, "edited", ["drawn", "painted"])
    strips.editing(tmp_path / "e.png", images)
    (sheet,) = sheets
    camera = images.views[1][1]
    assert list(dict.fromkeys(column for _, column in sheet)) == [
        "surfhead, γ = 0", "drawn", "painted", "alternating, γ = 0.25", "truth, γ = 0.25",
    ]  # fmt: skip
    row = f"camera {camera}"
    assert sheet[row, "surfhead, γ = 0"] == ("surfhead", 0.0, camera)
    assert sheet[row, "painted"] == ("painted", 0.25, camera)
    assert sheet[row, "alternating, γ = 0.25"] == ("alternating", 0.25, camera)


def test_an_avatar_is_edited_if_its_frames_say_that_their_mesh_has_level_0(study):
    folder, keywords = study
    subject = Capture.load(folder / "capture.json")
    truths = {level: read_ground_truth(file) for level, file in zip((0.0, 0.25), keywords["truths"], strict=True)}
    images = StudyImages(subject, {name: folder / name for name in keywords["variants"]}, truths, Figures(), 96)
    assert images.edited == []
    index = folder / keywords["variants"][0] / "level=0.25/frames.json"
    before = index.read_text()
    index.write_text(json.dumps([{**entry, "mesh_level": 0.0} for entry in json.loads(before)]))
    try:
        fresh = StudyImages(subject, images.frames, truths, Figures(), 96)
        assert fresh.edited == [keywords["variants"][0]]
    finally:
        index.write_text(before)


@pytest.mark.parametrize(("centre", "radius"), [((0.0, 0.0), 0.05), ((0.06, 0.03), 0.05)])
def test_the_window_of_the_hair_holds_it(centre, radius):
    """A ball in front of the camera, whose upper half has hair."""
    model = ball_model()
    vertices = model.v_template / np.abs(model.v_template).max() * radius + [*centre, 0]
    up = np.argmax(np.ptp(model.v_template, axis=0) * [0, 1, 0])
    hair = replace(model, regions={"scalp": np.flatnonzero(model.v_template[:, up] >= 0)})
    camera = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 300, 300, 60, 60, 120, 120)
    rows, columns = region_window(hair, vertices, camera, ["scalp", "beard"])
    assert (columns.stop - columns.start) / (rows.stop - rows.start) == pytest.approx(PROPORTIONS, rel=0.05)
    pixels, _ = camera.project(vertices[hair.regions["scalp"]])
    assert (pixels >= [columns.start, rows.start]).all() and (pixels <= [columns.stop, rows.stop]).all()
    assert region_window(hair, vertices, camera, ["beard"]) is None
