"""An avatar that follows a motion, and its clip."""

import numpy as np
import pytest
from avatars import CAMERA, TIMESTEPS, ball_avatar

from carigs.cli.main import main
from carigs.errors import CarigsWarning
from carigs.library import HeadAvatar
from carigs.library.sound import check_sound
from carigs.library.stretch import StretchCheck
from carigs.motion import Motion, read_motion, write_motion
from carigs.splat.avatar import save_avatar


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_the_captured_motion_through_a_file_is_the_captured_replay(avatar, tmp_path, suffix):
    write_motion(tmp_path / f"own.{suffix}", avatar.captured_motion())
    motion = read_motion(tmp_path / f"own.{suffix}")
    heads = list(avatar.animate(motion, 0.2))
    assert len(heads) == TIMESTEPS
    for t, head in enumerate(heads):
        replay = avatar.pose(0.2, timestep=t)
        np.testing.assert_allclose(head.vertices, replay.vertices, atol=1e-7)
        np.testing.assert_allclose(head.render(CAMERA), replay.render(CAMERA), atol=1e-4)


def test_a_stretch_is_that_of_the_map_of_the_triangle(avatar):
    """Scaled by 3 along one axis, the largest stretch of triangles along it is 3, and of none more."""
    sequence = avatar.avatar.sequence
    check = StretchCheck(sequence, None)
    check._known[:] = 1.0
    check.add(sequence.head.v_template * [3.0, 1.0, 1.0] + [0.0, 1.0, 0.0])
    assert check._found.max() == pytest.approx(3, abs=0.05) and check._found.min() >= 1 - 1e-6
    with pytest.warns(CarigsWarning, match=r"triangles are stretched up to (2\.9|3\.0) times the most"):
        check.warn()


def test_turning_and_moving_stretches_nothing(avatar):
    check = StretchCheck(avatar.avatar.sequence, None)
    for head in avatar.animate(Motion(30.0, (), np.zeros((2, 0)), rotation=np.full((2, 3), 0.9)), 0.0):
        check.add(head.vertices)
    np.testing.assert_allclose(check._found, 1, atol=1e-5)


def test_clips_of_motions(avatar, tmp_path, capsys):
    file = tmp_path / "avatar.npz"
    save_avatar(file, avatar.avatar)
    motion = avatar.captured_motion(10.0)
    write_motion(tmp_path / "own.npz", motion)
    small = ["--size", "32", "--level", "0.1"]
    assert main(["export", str(file), str(tmp_path / "a.webp"), "--motion", str(tmp_path / "own.npz"), *small]) == 0
    assert "a.webp: 3 images, 0.3 s" in capsys.readouterr().out
    again = ["--motion", str(tmp_path / "own.npz"), "--seconds", "1", "--fps", "8", *small]
    assert main(["export", str(file), str(tmp_path / "b.gif"), *again]) == 0
    assert "b.gif: 8 images, 1.0 s" in capsys.readouterr().out
    assert main(["motion", str(file), str(tmp_path / "again.npz"), "--motion-fps", "10"]) == 0
    np.testing.assert_array_equal(read_motion(tmp_path / "again.npz").rotation, motion.rotation)
    for options, message in (
        (["--mirror"], "--motion is missing"),
        (["--motion", "idle", "--motion", "talk"], "a clip shows one motion"),
        (["--motion", "idle", "--sweep", "orbit"], "a clip shows one motion"),
        (["--motion", "idle", "--timestep", "1"], "a motion shows its own frames"),
        (["--motion", "nothing"], "built in are idle and talk"),
        (["--motion", "idle", "--audio", str(file)], "only .mp4 and .webm clips and pages have sound"),
    ):
        assert main(["export", str(file), str(tmp_path / "c.webp"), *options]) == 1
        assert message in capsys.readouterr().err
    assert not (tmp_path / "c.webp").exists()


def test_sound_needs_ffmpeg_and_a_sound(tmp_path, monkeypatch):
    from carigs.errors import InputError, PackageMissing

    sound = tmp_path / "a.wav"
    with pytest.raises(InputError, match="no such sound"):
        check_sound(sound, tmp_path / "a.mp4")
    sound.write_bytes(b"RIFF")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PackageMissing, match="the program ffmpeg"):
        check_sound(sound, tmp_path / "a.mp4")
    with pytest.raises(InputError, match="a sound is one of"):
        check_sound(tmp_path / "a.txt", tmp_path / "a.mp4")
