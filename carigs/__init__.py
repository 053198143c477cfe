"""carigs: photorealistic, controllable 3D caricature avatars from multi-view captures.

From Python:

- `carigs.load(file)`: a trained avatar -> `carigs.library.head_avatar.HeadAvatar`, to pose, exaggerate and render
- `carigs.orbit(avatar)`: cameras around its head
- `carigs.exaggerate(vertices, faces, gamma)`: the caricature of any mesh
- `carigs.write_html(avatar, file)`: the avatar as one HTML file

They are imported when they are first used: `import carigs` itself takes milliseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from carigs.library import exaggerate, load, orbit
    from carigs.viewer.html.page import write_html

_MODULES = {
    "exaggerate": "carigs.library",
    "load": "carigs.library",
    "orbit": "carigs.library",
    "write_html": "carigs.viewer.html.page",
}
__all__ = ["exaggerate", "load", "orbit", "write_html"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        from importlib import import_module

        from carigs.system.extras import naming_extras

        with naming_extras():
            return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module 'carigs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
