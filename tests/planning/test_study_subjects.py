"""What is refused of the subjects of a study before any work starts."""

import pytest

from carigs.errors import SettingsError
from carigs.planning.study_subjects import check_subjects


def test_the_body_of_a_toy_cannot_be_cut():
    """The true caricature that it is compared with would keep it."""
    with pytest.raises(SettingsError, match=r"capture\.body=cut.*capture\.toy\.shirt"):
        check_subjects(["study=toy", "capture.body=cut"])
    assert check_subjects(["study=toy", "capture.toy.shirt=true"]) == "toy"
