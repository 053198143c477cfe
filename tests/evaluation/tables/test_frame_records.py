"""Records of an avatar's frames: round trip, and what is refused."""

import pytest

from carigs.errors import InputError
from evaluation.tables.frame_records import FrameRecord, read_frame_records, write_frame_records
from evaluation.tables.metric_records import MetricRecord, StudyPoint

POINT = StudyPoint("study", "anna", "surfhead", 0, 0.25, 0.1, "files")
RECORDS = [
    FrameRecord("test", 3, 7, "full", "depth_error", 1.25, ""),
    FrameRecord("test", None, 7, "face", "exaggeration_gain", -0.5, ""),
    FrameRecord("orbit", 0, 7, "skin", "hole_rate", None, 'the head model has no region scalp, "sic"'),
]


def test_records_round_trip_with_the_study_point(tmp_path):
    write_frame_records(tmp_path / "geometry.csv", RECORDS)
    assert read_frame_records(tmp_path / "geometry.csv", POINT) == [MetricRecord(*POINT, *record) for record in RECORDS]


def test_what_a_spreadsheet_saves_is_read(tmp_path):
    """With a byte order mark, CR LF at the ends of lines, and no quotes where none are needed."""
    file = tmp_path / "geometry.csv"
    write_frame_records(file, RECORDS)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    assert read_frame_records(file, POINT) == [MetricRecord(*POINT, *record) for record in RECORDS]
    file.write_text("text", "utf-16")
    with pytest.raises(InputError, match=r"geometry\.csv: not text in UTF-8 but in UTF-16"):
        read_frame_records(file, POINT)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("test,3,7,full,depth_error,1.0", "line 2: 6 cells, expected 7"),
        ("test,x,7,full,depth_error,1.0,", "line 2, camera: not a number: 'x'"),
        ("test,3,,full,depth_error,1.0,", "line 2, timestep: not a number"),
        ("test,3,7,full,depth_error,much,", "line 2, value: not a number: 'much'"),
        ("test,3,7,full,depth_error,,", "line 2, value: neither a value nor a reason"),
    ],
)
def test_malformed_lines_are_named(tmp_path, line, says):
    file = tmp_path / "geometry.csv"
    file.write_text(",".join(FrameRecord._fields) + f"\n{line}\n")
    with pytest.raises(InputError, match=says):
        read_frame_records(file, POINT)


@pytest.mark.parametrize("content", [b"", b"a,b\n", b"\xff\xfe"])
def test_other_files_are_refused(tmp_path, content):
    file = tmp_path / "geometry.csv"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"geometry\.csv: "):
        read_frame_records(file, POINT)
