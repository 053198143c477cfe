"""The image cache: eviction, prefetching, and errors of the reader."""

from pathlib import Path

import numpy as np
import pytest

from carigs.errors import InputError
from carigs.splat.training.image_cache import ImageCache

MEGABYTE = np.zeros((1024, 1024), np.uint8)


class Reader:
    """Counts how often each file is read."""

    def __init__(self):
        self.files = []

    def __call__(self, file):
        self.files.append(file.name)
        return MEGABYTE + np.uint8(len(file.name))


def test_images_are_read_once_and_the_least_recently_used_is_dropped():
    cache, read = ImageCache(3.5), Reader()
    for name in ("a", "bb", "ccc", "a", "dddd", "a", "ccc", "bb"):  # dddd drives out bb
        assert cache.get(Path(name), read)[0, 0] == len(name)
    assert read.files == ["a", "bb", "ccc", "dddd", "bb"]


def test_an_image_larger_than_the_budget_is_kept_until_the_next():
    cache, read = ImageCache(0.1), Reader()
    for name in ("a", "a", "bb", "a"):
        cache.get(Path(name), read)
    assert read.files == ["a", "bb", "a"]


def test_prefetched_images_are_not_read_again():
    cache, read = ImageCache(2.5), Reader()
    for name in ("a", "bb", "a"):
        cache.prefetch(Path(name), read)
    assert cache.get(Path("bb"), read)[0, 0] == 2
    cache.get(Path("a"), read)
    assert read.files == ["a", "bb"]


def test_errors_of_a_prefetch_are_raised_by_get():
    def read(file):
        raise InputError("not an image", file=file)

    cache = ImageCache(1)
    cache.prefetch(Path("a"), read)
    with pytest.raises(InputError, match="not an image"):
        cache.get(Path("a"), read)
