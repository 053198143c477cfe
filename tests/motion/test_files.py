"""Motion files: what is written is read, and odd or hostile files are refused or warned of by name."""

import json
import warnings

import numpy as np
import pytest
from motion.motions import NAMES, largest_difference, random_motion
from scipy.spatial.transform import Rotation
from small_head import small_head

from carigs.cli.main import main
from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.head import HeadParameters
from carigs.motion import Motion, read_motion, write_motion
from carigs.motion.facial_actions import ARKIT, name_map
from carigs.motion.tables import MAX_FRAMES


@pytest.mark.parametrize(("name", "error"), [("motion.npz", 0.0), ("motion.csv", 1e-9)])
def test_what_is_written_is_read(tmp_path, name, error):
    motion = random_motion()
    write_motion(tmp_path / name, motion)
    found = read_motion(tmp_path / name)
    assert found.fps == motion.fps and largest_difference(found, motion) <= error


def test_arkit_keeps_a_motion_also_where_it_has_fewer_names(tmp_path):
    motion = random_motion(names=("jawOpen", "browInnerUp_L", "browInnerUp_R", "lips_press"))
    write_motion(tmp_path / "take.arkit.csv", motion)
    found = read_motion(tmp_path / "take.arkit.csv")
    assert found.fps == motion.fps
    again = found.expression @ name_map(found.names, motion.names).T
    np.testing.assert_allclose(again, motion.expression, atol=1e-9)
    np.testing.assert_allclose(found.rotation, motion.rotation, atol=1e-9)
    np.testing.assert_allclose(found.rest_rotation, motion.rest_rotation, atol=1e-9)
    with pytest.raises(SettingsError, match="no expression has a name that ARKit knows"):
        write_motion(tmp_path / "numbers.arkit.csv", random_motion(names=("0", "1")))


def live_link(file, frames=4, values=None, rate=60, header=None, angles=(0.1, -0.05, 0.02), timecode=None):
    """A file as Live Link Face writes it."""
    names = [name[0].upper() + name[1:] for name in ARKIT]
    turns = [f"{what}{turn}" for what in ("Head", "LeftEye", "RightEye") for turn in ("Yaw", "Pitch", "Roll")]
    rows = [",".join(header or ["Timecode", "BlendshapeCount", *names, *turns])]
    for i in range(frames):
        numbers = {"JawOpen": 0.1 * (i % 10), **(values or {})}
        row = [str(numbers.get(name, 0.0)) for name in names] + list(map(str, angles)) + ["0.0"] * 6
        time = timecode(i) if timecode else f"10:20:{30 + i // rate:02d}:{i % rate:02d}.{(37 * i) % 1000:03d}"
        rows.append(",".join([time, "61", *row]))
    file.write_text("\n".join([*rows, ""]))
    return file


def test_a_take_of_live_link_face(tmp_path):
    found = read_motion(live_link(tmp_path / "take.csv", 90))
    assert found.fps == 60 and len(found) == 90 and set(found.names) >= {"JawOpen", "EyeBlinkLeft"}
    turned = Rotation.from_rotvec(found.rotation[0]).apply([0, 0, 1.0])
    assert turned[0] < 0 and turned[1] > 0  # yaw 0.1 to the right of the person, pitch -0.05 up
    np.testing.assert_array_equal(found.rest_rotation, 0)


@pytest.mark.parametrize("rate", [24, 30, 60])
def test_timecodes_count_frames_of_a_rate(tmp_path, rate):
    def timecode(i):
        return f"23:59:{i // rate:02d}:{i % rate:02d}.000"

    assert read_motion(live_link(tmp_path / "take.csv", 3 * rate, timecode=timecode)).fps == rate


def test_dropped_frames_are_bridged(tmp_path):
    file = tmp_path / "take.csv"
    t = np.delete(np.arange(20), [7, 8, 9])
    file.write_text("\n".join(["time,jawOpen", *(f"{i / 25},{i / 40}" for i in t), ""]))
    found = read_motion(file)
    assert found.fps == 25 and len(found) == 20
    np.testing.assert_allclose(found.expression[:, 0], np.arange(20) / 40, atol=1e-9)


def test_scores_of_mediapipe(tmp_path):
    frames = [
        [{"categoryName": "_neutral", "score": 0.1}, {"categoryName": "jawOpen", "score": 0.2 * i}] for i in range(3)
    ]
    file = tmp_path / "scores.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of 51 missing ones
        for content in (
            frames,
            {"frames": frames, "fps": 25},
            [{"blendshapes": frame, "timestamp_ms": 40 * i} for i, frame in enumerate(frames)],
            [{"faceBlendshapes": [{"categories": frame}]} for frame in frames],
            [{"jawOpen": 0.2 * i} for i in range(3)],
        ):
            file.write_text(json.dumps(content))
            found = read_motion(file)
            assert found.names == ("jawOpen",) and found.fps in (25, 30)
            np.testing.assert_allclose(found.expression[:, 0], [0, 0.2, 0.4])
        turned = Rotation.from_rotvec([0, 0.3, 0]).as_matrix()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[2, 3] = turned, -40
        file.write_text(json.dumps([{"jawOpen": 0.1, "matrix": matrix.ravel().tolist()}]))
        np.testing.assert_allclose(read_motion(file).rotation, [[0, 0.3, 0]], atol=1e-12)
        (tmp_path / "scores.csv").write_text("frame,timestamp_ms,_neutral,jawOpen\n0,0,.1,.5\n1,20,.1,.7\n")
        found = read_motion(tmp_path / "scores.csv")
        assert found.names == ("jawOpen",) and found.fps == 50


def test_folders_and_files_of_head_parameters(tmp_path):
    model, random = small_head(), np.random.default_rng(0)
    frames = [
        HeadParameters(
            translation=0.1 * random.normal(size=3), rotation=0.1 * random.normal(size=3),
            joints=0.1 * random.normal(size=(4, 3)), shape=np.zeros(6), expression=random.normal(size=5),
        )
        for _ in range(11)
    ]  # fmt: skip
    (tmp_path / "flame_param").mkdir()
    for t, frame in enumerate(frames):
        frame.save(tmp_path / "flame_param" / f"{t}.npz", model)
    found = read_motion(tmp_path, fps=25)
    assert found.fps == 25 and found.names == tuple("01234")
    for t, frame in enumerate(frames):  # 10 follows 9, not 1
        np.testing.assert_allclose(found.expression[t], frame.expression, atol=1e-6)
        np.testing.assert_allclose(found.joints["jaw"][t], frame.joints[1], atol=1e-6)
        np.testing.assert_allclose(found.joints["right_eye"][t], frame.joints[3], atol=1e-6)
        np.testing.assert_allclose(found.rotation[t], frame.rotation, atol=1e-6)
    np.testing.assert_allclose(found.rest_translation, frames[0].translation, atol=1e-6)


def test_results_of_trackers(tmp_path):
    random = np.random.default_rng(0)
    file = tmp_path / "track.npz"
    pose = 0.2 * random.normal(size=(7, 6))
    np.savez(file, exp=random.normal(size=(7, 50)), pose=pose, shape=np.zeros(100))
    found = read_motion(file)
    np.testing.assert_array_equal(found.rotation, pose[:, :3])
    np.testing.assert_array_equal(found.joints["jaw"], pose[:, 3:])
    lids = random.random((7, 2))
    np.savez(
        file, expression_params=np.zeros((7, 50)), jaw_params=pose[:, 3:], pose_params=pose[:, :3], eyelid_params=lids
    )
    found = read_motion(file)
    assert found.names[-2:] == ("eyeBlinkLeft", "eyeBlinkRight")
    np.testing.assert_array_equal(found.expression[:, -2:], lids)
    turned = Rotation.from_rotvec(pose[:, 3:]).as_matrix()
    np.savez(file, exp=np.zeros((7, 100)), jaw=2 * turned[:, :2].reshape(7, 6))
    np.testing.assert_allclose(read_motion(file).joints["jaw"], pose[:, 3:], atol=1e-9)


CSV = "time,jawOpen,eyeBlinkLeft\n"


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (CSV + "0,0.1,nan\n", "line 2, eyeBlinkLeft: 'nan' is not a finite number"),
        (CSV + "0,0.1,0\n0.1,,0\n", "line 3, jawOpen: 'an empty field'"),
        (CSV + "0,0.1\n", "line 2: 2 fields, the first line has 3"),
        (CSV + "0,0.1,0\n-1,0.1,0\n", "line 3: its time is earlier"),
        (CSV, "holds no frames"),
        ("", "holds no frames"),
        ("a,b\n1,2\n", "no column names an expression"),
        ("jawOpen,JawOpen\n1,2\n", "jawopen: two columns"),
        ("Timecode,JawOpen\n10:20,0\n", "line 2, Timecode: '10:20' is no timecode"),
        ("time,jaw_x,jaw_y,jaw_z\n0,12,0,0\n", "jaw: turns by more than half a turn; rotations are in radians"),
        ("time,rotation_x,rotation_y,rotation_z\n0,30,0,0\n", "rotation: a rotation of 30 rad"),
        (CSV + "0,0,0\n0.001,0,0\n9e6,0,0\n", "frames; at most"),
        (CSV + "0,1e300,0\n", "expression of frame 0"),
        ('time,"jawOpen\n0,1\n', "not a comma-separated table|holds no frames|no column"),
    ],
)
@pytest.mark.filterwarnings("ignore::carigs.errors.CarigsWarning")
def test_broken_tables_are_refused_by_name(tmp_path, content, match):
    file = tmp_path / "take.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=match) as error:
        read_motion(file)
    assert str(error.value).startswith(str(file)) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"values": {"JawOpen": 55.0}}, "JawOpen reaches 55: taken for percentages"),
        ({"values": {"JawOpen": 3.0}}, "JawOpen reaches 3, coefficients are from 0 to 1"),
        ({"angles": (12.0, 4.0, 0.0)}, "the head turns by 12 rad: taken for degrees"),
    ],
)
def test_other_units_are_warned_of(tmp_path, change, match):
    with pytest.warns(CarigsWarning, match=match):
        found = read_motion(live_link(tmp_path / "take.csv", **change))
    assert np.abs(found.rotation).max() < 0.3 and np.abs(found.expression).max() <= 3
    if "angles" in change:
        assert np.linalg.norm(found.rotation[0]) == pytest.approx(np.radians(12.65), abs=1e-3)


@pytest.mark.filterwarnings("ignore:.*does not have", "ignore:.*left out")
def test_unknown_and_missing_columns_are_warned_of_by_name(tmp_path):
    file = tmp_path / "take.csv"
    file.write_text("frame,JawOpen,wobble\n0,0.5,1\n1,0.6,1\n")
    with pytest.warns(CarigsWarning, match="left out: wobble"):
        assert read_motion(file).names == ("JawOpen",)
    with pytest.warns(CarigsWarning, match="taken as 0: eyeBlinkLeft"):
        read_motion(file)


def test_rows_without_a_face_are_bridged(tmp_path):
    file = live_link(tmp_path / "take.csv", 6)
    lines = file.read_text().splitlines()
    lines[3] = lines[3].split(",")[0] + ",0" + "," * (lines[3].count(",") - 1)
    file.write_text("\n".join(lines))
    with pytest.warns(CarigsWarning, match="1 frames without numbers, bridged"):
        found = read_motion(file)
    np.testing.assert_allclose(found.expression[2, found.names.index("JawOpen")], 0.2, atol=0.02)


def test_one_frame_is_a_motion_and_a_million_are_refused(tmp_path):
    file = tmp_path / "take.csv"
    file.write_text(CSV + "0,0.1,0.2\n")
    assert len(read_motion(file)) == 1
    file.write_text(CSV + "0,0,0\n" * 1_000_000)
    with pytest.raises(InputError, match=f"at most {MAX_FRAMES} frames"):
        read_motion(file)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such motion file"):
        read_motion(tmp_path / "none.csv")
    with pytest.raises(InputError, match="a motion is"):
        read_motion(tmp_path / "take.bvh")
    with pytest.raises(InputError, match="holds no head parameters"):
        read_motion(tmp_path)
    np.savez(tmp_path / "a.npz", shape=np.zeros(3))
    with pytest.raises(InputError, match="holds no expression"):
        read_motion(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", expr=np.zeros((3, 5)), jaw_pose=np.full((3, 3), 20.0))
    with pytest.raises(InputError, match="jaw_pose: a rotation of"):
        read_motion(tmp_path / "b.npz")
    for content in ("[]", "3", '[{"jawOpen": "x"}]', "[[1]]", '[{"jawOpen": 0, "matrix": [1]}]', "[null]"):
        (tmp_path / "c.json").write_text(content)
        with pytest.raises(InputError, match=r"c\.json"):
            read_motion(tmp_path / "c.json")
    with pytest.raises(SettingsError, match="0 frames per second"):
        read_motion(tmp_path / "none.csv", fps=0.0)


def test_the_command_edits_and_describes(tmp_path, capsys):
    write_motion(tmp_path / "in.npz", random_motion())
    arguments = [str(tmp_path / "in.npz"), str(tmp_path / "out.csv"), "--mirror", "--fps", "60", "--strength", "jaw=0"]
    assert main(["motion", *arguments]) == 0
    found = read_motion(tmp_path / "out.csv")
    assert found.fps == 60 and not found.expression[:, 0].any() and found.names == NAMES
    assert main(["motion", str(tmp_path / "in.npz")]) == 0
    assert "jawOpen 1.00" in capsys.readouterr().out.replace("0.99", "1.00").replace("0.98", "1.00")
    assert main(["motion", str(tmp_path / "none")]) == 1
    assert "built in are idle and talk" in capsys.readouterr().err


def test_a_motion_of_no_expressions_is_written(tmp_path):
    motion = Motion(30.0, (), np.zeros((3, 0)), {"neck": np.full((3, 3), 0.1)})
    for name in ("a.csv", "a.npz"):
        write_motion(tmp_path / name, motion)
        assert largest_difference(read_motion(tmp_path / name), motion) < 1e-9
