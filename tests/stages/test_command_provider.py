"""The provider `command` on the miniature subject: what the program gets, and what it may do wrong."""

import json
import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture
from carigs.capture.images import read_rgb8
from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.exaggeration import straight_path
from carigs.gtstar.by_command import find_program
from carigs.head import neutral, pose
from carigs.raster import rasterize_mesh
from carigs.readers.npz import read_npz
from carigs.settings import CaptureSettings, Gtstar
from carigs.stages.capture import capture
from carigs.stages.gtstar import gtstar

pytestmark = pytest.mark.filterwarnings("ignore::carigs.errors.CarigsWarning")

EVERY_FRAME = """
import json, shutil, sys
from pathlib import Path
folder = Path(sys.argv[-1])
content = json.loads((folder / "frames.json").read_text())
for number, frame in enumerate(content["frames"]):
    edited = folder / frame["edited"]
"""
COPIES = EVERY_FRAME + '    shutil.copy(folder / frame["image"], edited)\n'


@pytest.fixture(scope="module")
def subject(tmp_path_factory) -> Path:
    """Holds the ball's `capture.json`, and a `path.npz` whose level 0.25 stretches it sideways."""
    folder = tmp_path_factory.mktemp("subject")
    write_ball(folder / "ball")
    settings = CaptureSettings(
        source="folder", folder=str(folder / "ball"), head_model=str(folder / "ball/head_model.npz")
    )
    capture(settings, index=folder / "capture.json", dataset=folder / "dataset")
    person = Capture.load(folder / "capture.json")
    shape = neutral(person.model, person.parameters(0))
    straight_path(shape, person.model.faces, shape * [0.3, 0, 0], 0.25).save(folder / "path.npz")
    return folder


class Run:
    """Runs of the stage with a program that is written into a file."""

    def __init__(self, subject: Path, folder: Path) -> None:
        self.subject, self.folder = subject, folder
        folder.mkdir(exist_ok=True)
        self.exchange = folder / ".targets.part/notes/exchange"

    def __call__(self, program: str, *arguments: str, key: str = "key", **settings) -> dict:
        script = self.folder / "program.py"
        script.write_text(program)
        return self.by(sys.executable, str(script), *arguments, key=key, **settings)

    def by(self, *command: str, key: str = "key", **settings) -> dict:
        gtstar(
            Gtstar(**{"provider": "command", "command": command, **settings}), capture=self.subject / "capture.json",
            path=self.subject / "path.npz", level=0.25, targets=self.folder / "targets",
            index=self.folder / "targets.json", resume_key=key,
        )  # fmt: skip
        return json.loads((self.folder / "targets.json").read_text())


@pytest.fixture
def run(subject, tmp_path) -> Run:
    return Run(subject, tmp_path)


def test_a_program_that_copies_gives_the_targets_of_a_folder_with_the_frames(run, subject, tmp_path):
    index = run(COPIES)
    person = Capture.load(subject / "capture.json")
    edited = tmp_path / "edited"
    edited.mkdir()
    for frame in person.split("train"):
        shutil.copy(person.root / frame.image, edited / f"{frame.name}.png")
    other = Run(subject, tmp_path / "other")
    expected = other.by(provider="precomputed", folder=str(edited))
    assert index["targets"] == expected["targets"] and len(index["targets"]) == len(person.split("train"))
    for entry in index["targets"]:
        for name in (entry["image"], entry["mask_flags"]):
            assert (tmp_path / "targets" / name).read_bytes() == (tmp_path / "other/targets" / name).read_bytes()


def test_the_folder_says_all_that_a_program_needs_to_draw_the_mesh(run, subject, tmp_path):
    """Mesh and cameras of the folder, rasterized, are the mesh of the capture in its images."""
    run(COPIES + f"shutil.copytree(folder, {str(tmp_path / 'kept')!r})")
    kept, person = tmp_path / "kept", Capture.load(subject / "capture.json")
    content = json.loads((kept / "frames.json").read_text())
    assert (content["format"], content["level"]) == ("carigs-exchange-1", 0.25)
    faces = np.load(kept / "faces.npy")
    shape = neutral(person.model, person.parameters(0))
    exaggerated = straight_path(shape, person.model.faces, shape * [0.3, 0, 0], 0.25).at(0.25)
    for entry, frame in zip(content["frames"], person.split("train"), strict=True):
        camera = person.camera(frame)
        assert (entry["timestep"], entry["camera"]) == (frame.timestep, frame.camera)
        np.testing.assert_array_equal(read_rgb8(kept / entry["image"]), person.image8(frame))
        np.testing.assert_array_equal(entry["camera_from_world"], camera.camera_from_world)
        assert entry["intrinsics"] == list(camera.intrinsics) and entry["size"] == [camera.width, camera.height]
        meshes, parameters = read_npz(kept / entry["mesh"]), person.parameters(frame.timestep)
        np.testing.assert_allclose(meshes["natural"], pose(person.model, parameters))
        np.testing.assert_allclose(meshes["caricature"], pose(person.model, parameters, exaggerated))
        seen = rasterize_mesh(meshes["natural"], faces, camera).face >= 0
        matte = read_rgb8(kept / entry["mask"])[..., 0] > 127
        assert np.mean(seen == matte) > 0.97


def test_a_failure_is_named_by_frame_and_the_others_are_used(run, subject):
    program = (
        EVERY_FRAME
        + """
    if number == 0:
        edited.with_suffix(".txt").write_text("no face was found\\nsecond line")
    elif number > 1:
        shutil.copy(folder / frame["image"], edited)
"""
    )
    index = run(program)
    left_out = {(entry["timestep"], entry["camera"]): entry["why"] for entry in index["left_out"]}
    frames = Capture.load(subject / "capture.json").split("train")
    assert list(left_out) == [(frame.timestep, frame.camera) for frame in frames[:2]]
    first, second = left_out.values()
    assert first.endswith("the program says: no face was found")
    assert "ended without an edited image" in second
    assert len(index["targets"]) == len(frames) - 2


def test_images_of_another_size_are_named(run):
    program = (
        EVERY_FRAME
        + """
    import cv2
    image = cv2.imread(str(folder / frame["image"]))
    cv2.imwrite(str(edited), image if number else image[:-1])
"""
    )
    index = run(program)
    assert [entry["why"].split(": ")[-1] for entry in index["left_out"]] == ["40 x 47 pixels, its camera has 40 x 48"]


def test_a_run_that_fails_goes_on_with_the_frames_that_are_missing(run, capsys):
    dies = (
        COPIES
        + """
    if number == 1:
        (folder / content["frames"][2]["edited"]).write_bytes(b"half a file")
        sys.exit("out of memory")
"""
    )
    with pytest.raises(InputError, match=r"gtstar\.command: ended with exit code 1; its last line: out of memory"):
        run(dies)
    before = {file.name: file.stat().st_mtime_ns for file in (run.exchange / "edited").glob("*.png")}
    counted = COPIES + 'print(len(content["frames"]), file=open(sys.argv[1], "w"))'
    index = run(counted, str(run.folder / "count"))
    assert len(before) == 3 and int((run.folder / "count").read_text()) == len(index["targets"]) - 2
    assert "2 of" in capsys.readouterr().out and index["left_out"] == []
    whole = Run(run.subject, run.folder / "whole")
    assert whole(COPIES)["targets"] == index["targets"]


def test_reasons_of_a_run_that_failed_are_forgotten(run):
    """The next one asks for the frame again, and may say something else."""
    reason = (
        EVERY_FRAME
        + """
    if number:
        shutil.copy(folder / frame["image"], edited)
    elif len(sys.argv) == 3:
        edited.with_suffix(".txt").write_text("out of memory")
"""
    )
    with pytest.raises(InputError, match="exit code 1"):
        run(reason + "sys.exit(len(sys.argv) - 2)", "first")
    assert len([*(run.exchange / "edited").glob("*.txt")]) == 1
    index = run(reason)
    (left_out,) = index["left_out"]
    assert "ended without an edited image" in left_out["why"]


@pytest.mark.slow
def test_a_slow_program_has_the_time_anew_for_each_frame(run):
    """Six frames take 5 s in all, each less than the timeout."""
    program = (
        EVERY_FRAME
        + """
    import time
    time.sleep(0.8)
    shutil.copy(folder / frame["image"], edited)
"""
    )
    assert run(program, command_timeout=2.5)["left_out"] == []


def test_a_run_with_another_key_asks_for_all_frames_again(run):
    with pytest.raises(InputError, match="exit code 1"):
        run(COPIES + "sys.exit(1)")
    index = run(EVERY_FRAME + "print(len(content['frames']), file=open(sys.argv[1], 'w'))" + COPIES,
                str(run.folder / "count"), key="another")  # fmt: skip
    assert int((run.folder / "count").read_text()) == len(index["targets"])


@pytest.mark.parametrize(
    ("ending", "says"),
    [
        ("sys.exit(3)", r"ended with exit code 3; its last line: \(it printed nothing\)"),
        ("import os; os.kill(os.getpid(), 9)", "was ended by signal 9"),
        ("raise ValueError('no GPU')", "its last line: ValueError: no GPU"),
    ],
)
def test_the_end_of_a_program_is_one_line(run, ending, says):
    with pytest.raises(InputError, match=says) as raised:
        run("import sys\n" + ending)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_program_without_a_new_frame_is_ended_with_what_it_started(run):
    program = (
        EVERY_FRAME
        + """
    if number == 0:
        shutil.copy(folder / frame["image"], edited)
import subprocess, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(100)"])
Path(sys.argv[1]).write_text(str(child.pid))
time.sleep(100)
"""
    )
    started = time.monotonic()
    with pytest.raises(
        InputError, match=r"no new frame in 1 s, after 1 frames: .*remedy: raise gtstar\.command_timeout"
    ):
        run(program, str(run.folder / "child"), command_timeout=1.0)
    assert time.monotonic() - started < 20
    child = Path("/proc", (run.folder / "child").read_text())
    if child.parent.is_dir():
        deadline = time.monotonic() + 5
        while child.exists() and "Z" not in (child / "stat").read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not child.exists() or " Z " in (child / "stat").read_text()


def test_no_shell_reads_the_command(run):
    index = run(COPIES, "; touch", "$(touch x)", "*")
    assert index["left_out"] == []
    assert not any(path.name == "x" for path in run.folder.iterdir())


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ((), r"gtstar\.command must be set when gtstar\.provider is command"),
        (("no-such-program",), "gtstar.command=no-such-program: there is no such program"),
        (("python", "a\0b"), "NUL character"),
    ],
)
def test_a_command_that_cannot_run_is_refused_before_work(run, command, says):
    with pytest.raises(SettingsError, match=says):
        run.by(*command)
    assert not run.exchange.exists()


def test_a_file_that_is_no_program_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("text")
    with pytest.raises(SettingsError, match="cannot be executed"):
        find_program([str(tmp_path / "notes.txt")])


def test_when_no_frame_is_made_the_first_reason_is_the_error(run):
    with pytest.raises(InputError, match=r"no frame can be used; the first: .*ended without an edited image"):
        run("pass")


@pytest.mark.filterwarnings("default::carigs.errors.CarigsWarning")
def test_frames_without_a_target_are_counted_in_a_warning(run):
    with pytest.warns(CarigsWarning, match="1 of 6 frames have no targets"):
        run(EVERY_FRAME + '    if number: shutil.copy(folder / frame["image"], edited)\n')
