"""NumPy's files: what is ambiguous is refused."""

import io
import warnings
import zipfile

import numpy as np
import pytest

from carigs.errors import InputError
from carigs.readers.npz import read_npz


def test_two_arrays_of_one_name_are_refused(tmp_path):
    """NumPy returns one of them."""
    file = tmp_path / "twice.npz"
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # zipfile's, of the second member of a name
        for name, value in (("a", 1.0), ("b", 2.0), ("a", 3.0)):
            array = io.BytesIO()
            np.save(array, np.array([value]))
            archive.writestr(f"{name}.npy", array.getvalue())
    with pytest.raises(InputError, match=r"twice\.npz: a: two arrays have this name"):
        read_npz(file)
