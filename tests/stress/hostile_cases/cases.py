"""All cases of hostile and damaged files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from stress.hostile_cases import (
    arrays,
    colmap,
    every_reader,
    images,
    json_files,
    meshes,
    not_files,
    pickles,
    settings,
    splat_files,
)
from stress.hostile_cases.case import Case

ARRAYS = ("path", "shading", "head model", "gnm", "parameters", "avatar", "subject")
"""Readers of .npz files of carigs."""
OTHER_ARRAYS = (
    "vhap", "track", "metrical", "flame_param.npz", "landmarks", "landmarks of a frame", "embedding",
    "embedding of vertices", "avatar to glTF",
)  # fmt: skip
"""Readers of .npz files that have optional arrays, or accept other shapes as well."""
JSON = ("capture", "targets", "frames", "truth", "dataset", "footage", "cameras.json", "facekit index")


def cases(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """All cases, in a fixed order.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    yield from pickles.payloads(sound)
    for reader in ARRAYS:
        yield from arrays.wrong_arrays(reader, sound[reader])
    for reader in OTHER_ARRAYS:
        yield from arrays.wrong_arrays(reader, sound[reader], is_strict=False)
    for reader in JSON:
        yield from json_files.wrong_fields(reader, sound[reader])
    yield from arrays.false_headers()
    yield from images.false_sizes(sound)
    yield from every_reader.other_formats()
    yield from images.broken_markers(sound)
    yield from meshes.wrong_surfels(sound)
    yield from meshes.wrong_meshes(sound)
    yield from images.expensive_images(sound)
    yield from colmap.wrong_models(sound)
    yield from splat_files.wrong_splats(sound)
    yield from not_files.not_files(sound)
    yield from pickles.expanding_pickles()
    yield from json_files.broken_texts()
    yield from pickles.broken_pickles()
    yield from arrays.false_header_lengths(sound)
    yield from settings.wrong_yaml(sound["settings"])
    yield from settings.wrong_overrides()
    yield from every_reader.random_damage(sound)
