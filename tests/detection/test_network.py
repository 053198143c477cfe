"""What the runtime of networks writes on standard error."""

import os

import pytest

from carigs.detection.network import without_remarks


def test_remarks_are_left_out_and_errors_are_not(capfd):
    with without_remarks():
        os.write(2, b"INFO: Created a delegate.\nERROR: a tensor is missing\nhalf a line")
    os.write(2, b" and its end\n")
    assert capfd.readouterr().err == "ERROR: a tensor is missing\nhalf a line and its end\n"


def test_an_exception_loses_nothing_that_was_written_before(capfd):
    with pytest.raises(ValueError, match="broken"), without_remarks():
        os.write(2, b"ERROR: no such operation\n")
        raise ValueError("broken")
    assert capfd.readouterr().err == "ERROR: no such operation\n"
