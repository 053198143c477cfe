"""Each rule of docs/recording.md, broken alone, gives one sentence with its numbers; a good recording gives none."""

import numpy as np
import pytest
from project import ROOT
from tracking.recordings import COUNT, FPS, recording

from carigs.tracking.judgement.advice import advice, advice_of_cameras
from carigs.tracking.judgement.quality import TrackedFrames

GOOD = recording()
LATE = np.arange(COUNT) >= COUNT // 2


def leaving(share: float) -> TrackedFrames:
    """The first frames have no face."""
    gone = np.arange(COUNT) < share * COUNT
    changed = {
        name: np.where(gone, np.nan, getattr(GOOD, name)) for name in ("yaw", "pitch", "mouth", "eyes", "outside")
    }
    return recording(left_out=tuple("no face" if g else "" for g in gone), **changed)


def of_first(seconds: float) -> TrackedFrames:
    count = round(seconds * FPS)
    names = ("numbers", "times", "left_out", "face_width", "outside", "sharpness", "exposure")
    cut = {name: getattr(GOOD, name)[:count] for name in names}
    turns = {name: getattr(GOOD, name)[:: COUNT // count][:count] for name in ("yaw", "pitch", "mouth")}
    errors = {region: values[:count] for region, values in GOOD.errors.items()}
    return recording(**cut, **turns, errors=errors, eyes=GOOD.eyes[:count])


def test_a_good_recording_needs_no_advice():
    assert advice(GOOD) == []


def test_several_cameras_need_to_see_all_sides_together_and_each_the_whole_head():
    left, right = recording(yaw=GOOD.yaw.clip(0, None)), recording(yaw=GOOD.yaw.clip(None, 0))
    assert advice_of_cameras({"left": left, "right": right}) == []
    soft = recording(yaw=GOOD.yaw.clip(None, 0), sharpness=np.full(COUNT, 20.0))
    [line] = advice_of_cameras({"left": left, "right": soft})
    assert line.startswith("right: Focus on the face")


BROKEN = {
    "left": (recording(yaw=np.minimum(GOOD.yaw, 12)), "farther to the left: no frame shows it beyond 12 degrees"),
    "right": (recording(yaw=np.maximum(GOOD.yaw, -20)), "farther to the right: no frame shows it beyond 20 degrees"),
    "up": (recording(pitch=np.maximum(GOOD.pitch, -3)), "Raise your chin farther: no frame shows it beyond 3 degrees"),
    "down": (recording(pitch=np.minimum(GOOD.pitch, 0)), "Lower your chin farther: no frame shows it turned there"),
    "blurred": (recording(sharpness=GOOD.sharpness / 8), "Focus on the face and clean the lens: its sharpness is 25"),
    "fast": (
        recording(sharpness=np.where(np.arange(COUNT) < 75, 50, 200.0)),
        "Move more slowly or use more light: 15 % of the frames are blurred (0-74)",
    ),
    "exposure": (recording(exposure=np.where(LATE, 0.9, 0.0)), "Lock the exposure and keep the light as it is: the b"),
    "exposure at once": (recording(exposure=GOOD.exposure - 0.2 * LATE), "changes by 0.3 stops, at once in frame 250."),
    "zoom": (recording(face_width=GOOD.face_width * (1 + 0.4 * LATE)), "Do not zoom: the size of the face changes at"),
    "mouth": (recording(mouth=GOOD.mouth / 10), "Open your mouth wide, as for a long \"ah\": it opens by 3 %"),
    "eyes": (recording(eyes=np.maximum(GOOD.eyes, 0.27)), "no frame shows them less than 90 % open"),
    "short": (of_first(3), "Record longer, about 20 seconds: 75 frames of 3.0 seconds"),
    "outside": (
        recording(outside=np.where((np.arange(COUNT) > 99) & (np.arange(COUNT) < 120), 0.3, 0)),
        "Keep the whole head in the image: in frames 100-119 up to 30 % of it",
    ),
    "small": (recording(face_width=GOOD.face_width / 4), "at a higher resolution: the face is 55 pixels"),
    "left out": (leaving(0.2), "100 of 500 frames are left out (no face): 0-99"),
}  # fmt: skip


@pytest.mark.parametrize("rule", BROKEN)
def test_a_broken_rule_gives_its_sentence_and_no_other(rule):
    frames, expected = BROKEN[rule]
    found = advice(frames)
    assert len(found) == 1 and expected in found[0] and found[0].endswith(".")


def test_a_few_bad_frames_are_forgiven():
    few = np.arange(COUNT) < 20
    assert advice(recording(sharpness=np.where(few, 20, 200.0), exposure=np.where(few, 2, 0.0))) == []
    assert advice(recording(face_width=np.where(few, 300, 200.0))) == []
    # Whoever was away for a moment may come back nearer to the camera, and to a lamp.
    away = tuple("no face" if 240 <= i < 250 else "" for i in range(COUNT))
    assert advice(recording(left_out=away, face_width=np.where(LATE, 300, 200.0), exposure=0.3 * LATE)) == []
    assert advice(leaving(0.05)) == []


def test_a_still_person_is_asked_for_no_motion_but_for_more_of_the_camera():
    still = recording(
        yaw=np.linspace(-35, 10, COUNT), pitch=np.zeros(COUNT), mouth=np.zeros(COUNT), eyes=np.full(COUNT, 0.3)
    )
    assert [line.split(":")[0] for line in advice(still, moving_camera=True)] == [
        "Move the camera farther to the person's right"
    ]
    assert len(advice(still)) == 5


def test_without_a_tracked_frame_there_is_the_reason_alone():
    nothing = np.full(COUNT, np.nan)
    values = dict.fromkeys(("yaw", "pitch", "face_width", "outside", "mouth", "eyes", "sharpness"), nothing)
    found = advice(recording(left_out=("no face",) * COUNT, errors={"lips": nothing}, **values))
    assert found == ["No frame could be tracked. 500 of 500 frames are left out (no face): 0-499."]


def test_the_page_on_recording_has_every_sentence():
    page = (ROOT / "docs" / "recording.md").read_text("utf-8")
    for frames, _ in BROKEN.values():
        sentence = advice(frames)[0]
        assert sentence.split(":")[0] in page
