"""The list of planted faults fits the code: every fault can be planted, and changes a file."""

import pytest
from planted_faults import ROOT, Fault, first_failure, read_faults, write_source

FAULTS = {fault.name: fault for fault in read_faults()}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_stands_once_in_its_file(name):
    fault = FAULTS[name]
    broken = fault.planted()
    assert broken != (ROOT / fault.file).read_text("utf-8")
    if fault.file.endswith(".py"):
        compile(broken, fault.file, "exec")
    assert fault.tests and all((ROOT / folder).is_dir() for folder in fault.tests)


def test_a_fault_that_fits_no_text_or_several_is_refused(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\nx = 1\n")
    for old, count in (("x = 1", 2), ("y = 1", 0)):
        with pytest.raises(ValueError, match=f"fault: found {count} times in a.py"):
            Fault("fault", "", "a.py", old, "x = 2", []).planted(tmp_path)


def test_the_first_failing_test_is_named(tmp_path):
    """Also after an edit within a second that keeps the size of the file."""
    (tmp_path / "tests").mkdir()
    (tmp_path / "module.py").write_text("VALUE = 1\n")
    (tmp_path / "tests/test_it.py").write_text("from module import VALUE\ndef test_value():\n    assert VALUE == 1\n")
    assert first_failure(tmp_path, ["tests"]) == ""
    write_source(tmp_path / "module.py", "VALUE = 2\n")
    assert first_failure(tmp_path, ["tests"]) == "tests/test_it.py::test_value"
