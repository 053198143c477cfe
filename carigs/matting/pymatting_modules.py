"""Modules of pymatting, loaded one by one.

`import pymatting` compiles the kernels of every method in the package, which takes more than a minute the first time.
The modules that mattes need import nothing from the others, and compile in ten seconds.
"""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.system.extras import need

if TYPE_CHECKING:
    from types import ModuleType


@cache
def pymatting_module(name: str) -> ModuleType:
    """Load a module of the package of the optional extra `video`, without the package around it.

    Args:
        name: Dotted name within the package, of a module that imports nothing from the package.

    Returns:
        The module; `sys.modules` does not hold it.

    Raises:
        PackageMissing: If pymatting is not installed.
    """
    need("pymatting")
    package = find_spec("pymatting")
    assert package is not None and package.origin is not None  # `need` has found it
    spec = spec_from_file_location(f"pymatting.{name}", Path(package.origin).parent / f"{name.replace('.', '/')}.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
