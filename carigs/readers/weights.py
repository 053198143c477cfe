"""Reader of network weights: .safetensors, and PyTorch's files without any code of theirs."""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carigs.errors import InputError
from carigs.readers.limits import regular_file_size

if TYPE_CHECKING:
    import torch

MAX_WEIGHTS_BYTES = 8 << 30
"""Largest file of weights, and largest sum of its parameters, in bytes."""
MAX_PARAMETERS = 100_000


def read_weights(file: str | Path, trusted: Collection[str] = ()) -> dict[str, torch.Tensor]:
    """Read network parameters to the CPU.

    Args:
        file: A .safetensors file, or a file of `torch.save`. A TorchScript archive holds code that runs when it is
            loaded: it is refused unless it is trusted.
        trusted: SHA-256 of TorchScript archives that may be loaded, in hexadecimal digits.

    Returns:
        Finite parameters by name.

    Raises:
        InputError: If the file is missing, damaged, too large, or a TorchScript archive that is not trusted, or if it
            holds anything else than finite parameters by name.
    """
    import torch

    file = Path(file)
    size = regular_file_size(file, "file of weights")
    if size > MAX_WEIGHTS_BYTES:
        raise InputError(f"{size} bytes; at most {MAX_WEIGHTS_BYTES} are read", file=file)
    try:
        if file.suffix == ".safetensors":
            from safetensors.torch import load_file

            state = load_file(file)
        elif _is_torchscript(file):
            with file.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            if digest not in trusted:
                problem = f"a TorchScript archive, which can run code, with the unknown sha256 {digest[:12]}..."
                raise InputError(problem, file=file)
            state = torch.jit.load(file, map_location="cpu").state_dict()
        else:
            state = torch.load(file, map_location="cpu", weights_only=True)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # a damaged file can fail anywhere
        problem = " ".join(str(error).split())[:120]
        raise InputError(f"not a readable file of weights ({type(error).__name__}: {problem})", file=file) from error
    _check(state, file)
    return dict(state)


def _is_torchscript(file: Path) -> bool:
    """Whether this is a zip file with `constants.pkl`; other zip files are checked for damage."""
    if not zipfile.is_zipfile(file):
        return False
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        if any(member.filename.endswith("/constants.pkl") for member in members):
            return True
        if any(member.compress_type != zipfile.ZIP_STORED for member in members):  # a small file, large data
            raise InputError("holds compressed parts, which torch.save never writes", file=file)
        if damaged := archive.testzip():  # PyTorch does not compare the checksums
            raise InputError("wrong checksum", file=file, field=damaged)
    return False


def _check(state: Any, file: Path) -> None:
    import torch

    if not isinstance(state, dict) or not state or not all(isinstance(name, str) for name in state):
        raise InputError(f"holds a {type(state).__name__}, expected parameters by name", file=file)
    if len(state) > MAX_PARAMETERS:
        raise InputError(f"{len(state)} parameters; at most {MAX_PARAMETERS} are read", file=file)
    total = 0
    for name, value in state.items():
        if not isinstance(value, torch.Tensor):
            raise InputError(f"holds a {type(value).__name__}, expected a tensor", file=file, field=name)
        if value.layout != torch.strided or value.device.type != "cpu" or value.is_complex() or value.is_quantized:
            raise InputError(
                f"{value.dtype} in the layout {value.layout}, expected plain numbers", file=file, field=name
            )
        total += math.prod(value.shape) * value.element_size()  # a view can be larger than what is stored
        if total > MAX_WEIGHTS_BYTES:
            raise InputError(f"more than {MAX_WEIGHTS_BYTES} bytes of parameters", file=file, field=name)
        if value.is_floating_point() and not value.isfinite().all():
            raise InputError("holds a number that is not finite", file=file, field=name)
