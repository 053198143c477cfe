"""Fields of the settings with default, unit and allowed values, and the check of values against them.

The meaning of a field is the docstring below it.
"""

from __future__ import annotations

import operator
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

from carigs.errors import SettingsError
from carigs.readers.given_paths import path_problem

MAX_COUNT = 1_000_000_000
"""Largest number of things that are counted one by one."""
MAX_SEED = 2**32 - 1
OF_PATH = "the path of the job"
"""`Option.set_by` of a field that each job sets from the path of its results."""


@dataclass(frozen=True)
class Option:
    """What a field of the settings allows."""

    unit: str = ""
    """Empty for numbers without a unit."""
    ge: float | None = None
    """Smallest allowed value; of each element where the field is a sequence."""
    gt: float | None = None
    """Values must be larger than this."""
    le: float | None = None
    """Largest allowed value."""
    lt: float | None = None
    """Values must be smaller than this."""
    excluded: float | None = None
    """A value inside the range that is not allowed."""
    choices: tuple[str, ...] = ()
    """Allowed words; of each element where the field is a sequence."""
    choices_name: str = ""
    """What the choices are, for the reference; they are listed there if this is empty."""
    pattern: str = ""
    """Regular expression that a text must match as a whole."""
    pattern_name: str = ""
    """What such a text is."""
    required_when: tuple[str, tuple[str, ...]] | None = None
    """Another field of the section, and its values that make this field necessary."""
    set_by: str = ""
    """Key that sets this field, or `OF_PATH`: the field is no key of its own. Composition copies the value of the key,
    so that a stage reads only its own section."""
    is_path: bool = False
    """The value names a file or folder: what was made from it is made again when it changes."""
    is_program: bool = False
    """The value is a program and its arguments: what it made is made again when a file that they name changes."""

    def allowed(self) -> str:
        """The allowed values in words.

        Returns:
            For example `be at least 1`; empty if only the type restricts the values.
        """
        if self.choices:
            return ", ".join(self.choices[:-1]) + f" or {self.choices[-1]}"
        if self.pattern:
            return f"be {self.pattern_name}"
        low, high = (b if a is None else a for a, b in ((self.ge, self.gt), (self.le, self.lt)))
        text = ""
        if low is not None and high is not None:
            first, last = "[" if self.ge is not None else "(", "]" if self.le is not None else ")"
            text = f"lie in {first}{low:.10g}, {high:.10g}{last}"
        elif low is not None:
            text = f"be {'at least' if self.ge is not None else 'above'} {low:.10g}"
        return f"{text} and not be {self.excluded:.10g}" if self.excluded is not None else text

    def problem(self, value: Any) -> str:
        """Check one value.

        Args:
            value: The value, or an element of a sequence or mapping.

        Returns:
            What is wrong with it; empty if nothing is.
        """
        if self.is_path and value:
            return path_problem(value)
        if self.choices:
            return "" if value in self.choices else f"is unknown; choose {self.allowed()}"
        if self.pattern and value is not None:
            return "" if re.fullmatch(self.pattern, str(value)) else f"must {self.allowed()}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            return "" if isinstance(value, bool | str | None) else "must be one value"
        if not abs(value) <= sys.float_info.max:  # also refuses NaN, and whole numbers of hundreds of digits
            return "must be a finite number"
        bounds = ((operator.ge, self.ge), (operator.gt, self.gt), (operator.le, self.le), (operator.lt, self.lt))
        inside = all(bound is None or compare(value, bound) for compare, bound in bounds)
        return "" if inside and value != self.excluded else f"must {self.allowed()}"


def option(default: Any, **allowed: Any) -> Any:
    """A field of a section.

    Args:
        default: The default.
        **allowed: Unit, bounds, choices and conditions, as in `Option`.

    Returns:
        The dataclass field.

    Example:
        >>> iterations: int = option(1500, ge=1)
    """
    metadata = {"option": Option(**allowed)}
    if isinstance(default, dict):
        return field(default_factory=default.copy, metadata=metadata)
    return field(default=default, metadata=metadata)


def set_by(key: str, default: Any, **allowed: Any) -> Any:
    """A field that a stage reads and users set by a key of another section.

    Args:
        key: That key, or the name of a whole section, or `OF_PATH`.
        default: The default, for calls from Python; a class of sections for a section.
        **allowed: As for `option`.

    Returns:
        The dataclass field.

    Example:
        >>> gamma: float = set_by("gamma", 0.25)
    """
    if isinstance(default, type):
        return field(default_factory=default, metadata={"option": Option(set_by=key)})
    return option(default, set_by=key, **allowed)


class Section:
    """Base of the dataclasses of settings: their values are checked when they are made.

    Subclasses state the `key` of their section, as in `class Toy(Section, key="capture.toy")`.
    """

    key: ClassVar[str]

    def __init_subclass__(cls, key: str) -> None:
        cls.key = key

    def __post_init__(self) -> None:
        for f in fields(self):
            value, below = getattr(self, f.name), subsection(f)
            if isinstance(value, list):  # OmegaConf has lists only
                setattr(self, f.name, tuple(value))
            elif below and isinstance(value, Mapping):
                setattr(self, f.name, below(**value))
        check_section(type(self), self)


def option_of(f: Field) -> Option:
    """What a field allows.

    Args:
        f: Field of a section.

    Returns:
        Its option; without restrictions for a plain default.
    """
    return f.metadata.get("option", Option())


def subsection(f: Field) -> type[Section] | None:
    """The class of a field that is a section itself, else None.

    Args:
        f: Field of a section.

    Returns:
        The dataclass, or None.
    """
    made_by = f.default_factory
    return made_by if isinstance(made_by, type) and issubclass(made_by, Section) else None


def walk(section: type[Section]) -> Iterator[tuple[str, type[Section], Field]]:
    """The fields of a section and of its subsections.

    Args:
        section: Class of the section.

    Yields:
        Dotted key, class that the field belongs to, and the field.
    """
    for f in fields(section):
        if below := subsection(f):
            yield from walk(below)
        else:
            yield f"{section.key}.{f.name}".lstrip("."), section, f


def keys(section: type[Section]) -> Iterator[tuple[str, type[Section], Field]]:
    """The keys that users can set in a section and its subsections.

    Args:
        section: Class of the section.

    Yields:
        As `walk`, without fields that are set by other keys.
    """
    for f in fields(section):
        if option_of(f).set_by:
            continue
        if below := subsection(f):
            yield from keys(below)
        else:
            yield f"{section.key}.{f.name}".lstrip("."), section, f


def copies(section: type[Section]) -> Iterator[tuple[str, str]]:
    """The fields of a section and its subsections that are set by other keys.

    Args:
        section: Class of the section.

    Yields:
        Dotted name of the field, and what sets it: `Option.set_by`.
    """
    for f in fields(section):
        if source := option_of(f).set_by:
            yield f"{section.key}.{f.name}".lstrip("."), source
        elif below := subsection(f):
            yield from copies(below)


def check_section(section: type[Section], values: Any) -> None:
    """Check every value of a section and of its subsections.

    Args:
        section: Class of the section.
        values: An instance of it, or the OmegaConf section with the same keys.

    Raises:
        SettingsError: One line that names the first wrong key, its value and what is allowed.
    """
    for f in fields(section):
        value, key = getattr(values, f.name), f"{section.key}.{f.name}".lstrip(".")
        if below := subsection(f):
            check_section(below, value)
            continue
        allowed = option_of(f)
        if allowed.required_when and not value:
            other, needed = allowed.required_when
            if (chosen := getattr(values, other)) in needed:
                raise SettingsError(f"{key} must be set when {section.key}.{other} is {chosen}")
        for place, element in _elements(value):
            if problem := allowed.problem(element):
                shown = f"{element:g}" if isinstance(element, float) else str(element)[:60]
                raise SettingsError(f"{key}{place}={shown} {problem}")


def _elements(value: Any) -> Iterator[tuple[str, Any]]:
    """The value itself, or the elements of a sequence or mapping, each with its place in the key."""
    if isinstance(value, Mapping):
        yield from ((f".{name}", element) for name, element in value.items())
    elif isinstance(value, str) or not hasattr(value, "__iter__"):
        yield "", value
    else:
        yield from ((f"[{i}]", element) for i, element in enumerate(value))
