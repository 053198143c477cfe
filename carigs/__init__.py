"""carigs: photorealistic, controllable 3D caricature avatars from multi-view captures.

From Python:

- `carigs.load(file)`: a trained avatar -> `carigs.library.head_avatar.HeadAvatar`, to pose, exaggerate and render
- `carigs.orbit(avatar)`: cameras around its head
- `carigs.exaggerate(vertices, faces, gamma)`: the caricature of any mesh

They are imported when they are first used: `import carigs` itself takes milliseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from carigs.library import exaggerate, load, orbit

__all__ = ["exaggerate", "load", "orbit"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from importlib import import_module

        return getattr(import_module("carigs.library"), name)
    raise AttributeError(f"module 'carigs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
