"""Extensions of glTF: which of them change the triangles of a file, and which of those are read.

The registry is github.com/KhronosGroup/glTF/tree/main/extensions.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from carigs.errors import CarigsWarning, InputError
from carigs.readers.json_files import json_field

QUANTIZATION = "KHR_mesh_quantization"
"""Positions may be whole numbers."""
COMPRESSIONS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
"""Take the place of the data of a primitive or a view, which then need no data of their own."""
OTHER_SURFACES = {
    "EXT_mesh_gpu_instancing": "copies of meshes",
    "KHR_node_visibility": "hidden meshes",
    "MSFT_lod": "meshes in several resolutions",
}
"""What a reader without these extensions shows as plain meshes. A file may use them without requiring them."""
_READ = (QUANTIZATION, "FB_ngon_encoding")
_NO_GEOMETRY = (
    "KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_animation_pointer", "EXT_texture_", "EXT_lights_",
    "MSFT_texture_", "MSFT_packing_", "ADOBE_materials_", "VRM", "EXT_materials_", "KHR_audio", "KHR_interactivity",
    "EXT_structural_metadata", "EXT_mesh_features", "CESIUM_primitive_outline", "GODOT_single_root",
    "KHR_node_selectability", "KHR_node_hoverability",
)  # fmt: skip
"""Beginnings of names of extensions for what is ignored: materials, textures, lights, sounds, animations, metadata."""


def check_extensions(document: dict[str, Any], file: str | Path) -> set[str]:
    """Refuse a file that needs an extension which is not read.

    Args:
        document: The JSON document.
        file: Its file, for messages.

    Returns:
        Names of all extensions that the file uses.

    Raises:
        InputError: If the file requires an extension that may change the triangles and is not read.

    Warns:
        CarigsWarning: The file uses an extension without which other triangles are shown.
    """
    used, required = (
        [name for name in json_field(document, key, list, file=file) if isinstance(name, str)]
        if key in document
        else []
        for key in ("extensionsUsed", "extensionsRequired")
    )
    for name in required:
        if name not in _READ and not name.startswith(_NO_GEOMETRY):
            raise not_read(name, file, "extensionsRequired")
    for name, what in OTHER_SURFACES.items():
        if name in used:
            warnings.warn(f"{file}: {what} ({name}) are read as plain meshes", CarigsWarning, stacklevel=2)
    return {*used, *required}


def check_compression(entry: dict[str, Any], file: str | Path, where: str) -> None:
    """Refuse a part of a document whose data are compressed.

    Args:
        entry: A primitive, view or buffer that has no data of its own.
        file: The file, for messages.
        where: Position of the part in the document.

    Raises:
        InputError: If an extension holds its data.
    """
    extensions = entry.get("extensions")
    for name in COMPRESSIONS:
        if isinstance(extensions, dict) and name in extensions:
            raise not_read(name, file, f"{where}.extensions")


def not_read(name: str, file: str | Path, field: str) -> InputError:
    """The error of an extension that is not read.

    Args:
        name: Its name.
        file: The file, for messages.
        field: Where the file names it.

    Returns:
        The error, which says what to do.
    """
    remedy = "save the mesh without compression" if "compression" in name else "save the mesh without it"
    return InputError(f"needs the extension {name[:60]}, which is not read; {remedy}", file=file, field=field)
