"""Array shapes in signatures are checked while the tests run: an import hook that decorates the functions of carigs.

jaxtyping's own hook decorates every function of a module, which Numba then cannot compile. This one leaves functions
alone that Numba compiles, so that modules with kernels have the signatures of their other functions checked, too.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
import marshal
import math
import os
import re
import sys
from contextlib import suppress
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import CodeType
from typing import Any, get_type_hints

from beartype import beartype
from jaxtyping import AbstractArray, jaxtyped

KEEP_PYTHON = {
    "cache", "cached_property", "classmethod", "contextmanager", "dataclass", "functools.cache", "property",
    "staticmethod", "torch.no_grad",
}  # fmt: skip
"""Decorators after which a function is still Python's; functions with any other may be Numba's."""
CHECKED_CALLS = math.inf if os.environ.get("CARIGS_CHECK_ALL") else 5
"""Calls of each function that are checked in each test: the first five in `make test`, all in `make test-more` and
`make coverage`."""
_ARRAY = re.compile(r"\w+\[[\w.]+, '[^']*'\]")
"""The hint of an array, as modules with `from __future__ import annotations` hold it."""
_test = 0
_THIS = Path(__file__).read_bytes()
CHECK = "__import__('typecheck').check"


def typecheck(function):
    """The function with the shapes of its array arguments and of its result checked by beartype.

    Other hints are left alone, so that tests may pass stand-ins.
    """
    if isinstance(function, type):
        return function
    hints = {**function.__annotations__, **_resolved(function)}
    function.__annotations__ = {name: hint if _is_array(hint) else Any for name, hint in hints.items()}
    return beartype(function)


with_shapes = jaxtyped(typechecker=typecheck)


def check(target):
    """A dataclass whose fields are checked, or a function whose first calls in each test are."""
    if not _names_arrays(target):
        return target
    if isinstance(target, type):
        return with_shapes(target)
    checked, test, left = None, -1, 0

    @functools.wraps(target)
    def call(*args, **keywords):
        nonlocal checked, test, left
        if test != _test:
            test, left = _test, CHECKED_CALLS
        if left == 0:
            return target(*args, **keywords)
        left -= 1
        if checked is None:  # what is never called is never prepared
            checked = _prepared(target)
        return checked(*args, **keywords)

    return call


def _names_arrays(target) -> bool:
    """Whether one of the hints is an array, or a name for one. Without, calls need not be counted either."""
    scope = vars(sys.modules[target.__module__])
    for part in target.__mro__ if isinstance(target, type) else (target,):
        for hint in inspect.get_annotations(part).values():
            if (_ARRAY.fullmatch(hint) if isinstance(hint, str) else False) or _is_array(scope.get(hint, hint)):
                return True
    return False


def _prepared(target):
    """The function with its checks, in which arrays of shapes that have passed are not checked again.

    A check depends on nothing but types and shapes, and takes longer than most functions.
    """
    hints = {name: hint for name, hint in _resolved(target).items() if _is_array(hint)}
    if not hints:
        return target
    checked, signature = with_shapes(target), inspect.signature(target)
    of_values = any("{" in hint.dim_str for hint in hints.values())
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    if of_values or any(name in hints for name, p in signature.parameters.items() if p.kind in variadic):
        return checked
    check_result, known = _result_check(target, hints, signature) if "return" in hints else None, {}

    def call(*args, **keywords):
        key = (*map(_kind, args), *((name, _kind(value)) for name, value in keywords.items()))
        results = known.get(key)
        if results is None:
            result = checked(*args, **keywords)
            known[key] = {_kind(result)}
            return result
        result = target(*args, **keywords)
        if check_result is not None and (kind := _kind(result)) not in results:
            check_result(result, *args, **keywords)
            results.add(kind)
        return result

    return call


def _kind(value: Any) -> Any:
    """All of a value that a check depends on."""
    kind = type(value)
    return (kind, value.dtype, value.shape) if hasattr(value, "shape") and hasattr(value, "dtype") else kind


def _result_check(target, hints: dict[str, Any], signature: inspect.Signature):
    """A function of a result and of the arguments that it was returned for, which raises an error if it is wrong."""
    names = [name for name in hints if name != "return"]
    parameters = ", ".join(f"{name}=None" for name in [*names, "_result"])
    scope: dict[str, Any] = {}
    exec(f"def {target.__name__}(*, {parameters}): return _result", scope)
    returned = scope[target.__name__]
    returned.__annotations__, returned.__module__ = hints, target.__module__
    returned = with_shapes(returned)

    def check_result(result, *args, **keywords):
        given = signature.bind(*args, **keywords).arguments
        returned(_result=result, **{name: given[name] for name in names if name in given})

    return check_result


def begin_test() -> None:
    """Check first calls again."""
    global _test
    _test += 1


def install(*packages: str) -> None:
    """Check the functions of all modules of these packages that are imported from now on."""
    sys.meta_path.insert(0, _Finder(packages))


class _Finder(MetaPathFinder):
    def __init__(self, packages: tuple[str, ...]) -> None:
        self.packages = packages

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name.partition(".")[0] not in self.packages:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    def get_code(self, name: str) -> Any:
        """Compile the decorated source, once: its bytecode lies beside that of the source as it is."""
        path = self.get_filename(name)
        source = self.get_data(path)
        key = hashlib.sha256(path.encode() + b"\0" + source + _THIS).digest()
        cached = Path(cache_from_source(path, optimization="typecheck"))
        with suppress(OSError, ValueError, EOFError, TypeError):
            found = cached.read_bytes()
            if found.startswith(key):
                return marshal.loads(found[len(key) :])
        code = self._compiled(path, source)
        with suppress(OSError):
            part = cached.with_name(f"{cached.name}.{os.getpid()}")
            cached.parent.mkdir(exist_ok=True)
            part.write_bytes(key + marshal.dumps(code))
            part.replace(cached)
        return code

    def _compiled(self, path: str, source: bytes) -> CodeType:
        tree = ast.parse(source, path)
        compiled = _names_given_to_calls(tree) if b"numba" in source or b"carigs.simd" in source else set()
        for function in _functions(tree):
            if function.name not in compiled and {ast.unparse(d) for d in function.decorator_list} <= KEEP_PYTHON:
                function.decorator_list.append(_decorator(function))
        for node in tree.body:
            if isinstance(node, ast.ClassDef):  # of dataclasses, the fields are checked
                node.decorator_list.insert(0, _decorator(node))
        return compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True)


def _decorator(node: ast.stmt) -> ast.expr:
    return ast.copy_location(ast.parse(CHECK, mode="eval").body, node)


def _functions(tree: ast.Module) -> list[ast.FunctionDef]:
    """Functions of a module and methods of its classes."""
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    return [node for body in bodies for node in body if isinstance(node, ast.FunctionDef)]


def _names_given_to_calls(tree: ast.Module) -> set[str]:
    """Names that are arguments of calls in the module's body, as in `kernel(function)`: Numba may compile them."""
    statements = [node for node in tree.body if not isinstance(node, ast.FunctionDef | ast.ClassDef)]
    calls = [node for statement in statements for node in ast.walk(statement) if isinstance(node, ast.Call)]
    return {node.id for call in calls for a in call.args for node in ast.walk(a) if isinstance(node, ast.Name)}


def _resolved(function) -> dict[str, Any]:
    try:
        return get_type_hints(function)
    except NameError:  # a name that only type checkers import
        return {}


def _is_array(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)
