"""Embeddings of images: each image passes the network once, whichever process, variant or level asks for it."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from processes import started

from carigs.capture.images import read_rgb, write_png
from evaluation.metrics.networks.embedder import Embedder
from evaluation.metrics.networks.embedding_cache import EmbeddingCache, digest_of
from evaluation.metrics.networks.preprocessing import Preprocessing


@pytest.fixture
def frames(tmp_path):
    generator = np.random.default_rng(0)
    files = [tmp_path / f"{i}.png" for i in range(19)]
    for file in files:
        write_png(file, generator.random((20, 15, 3)))
    return files


@pytest.fixture
def passes():
    """The numbers of images of the passes of the network."""
    return []


@pytest.fixture
def embed(tmp_path, passes):
    """An embedder with a linear network."""
    import torch

    weights = torch.randn(3 * 16 * 16, 12, generator=torch.Generator().manual_seed(0))

    def network(images):
        passes.append(len(images))
        features = images.flatten(1) @ weights
        return {"first": features[:, :8], "second": features[:, 8:].half()}

    prepare = Preprocessing((0.5,) * 3, (0.5,) * 3, "pad_square", size=16)
    return Embedder("linear", "identity", network, prepare, EmbeddingCache(tmp_path / "embeddings"))


def again(embed, **changes):
    """The embedder of another process with the same cache."""
    return replace(embed, pixels={}, **changes)


def test_embeddings_have_length_one_and_do_not_depend_on_the_batch(embed, frames, tmp_path):
    together = embed(frames, "first")
    assert together.shape == (19, 8) and together.dtype == np.float64
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1)
    alone = again(embed, cache=EmbeddingCache(tmp_path / "other"))
    np.testing.assert_allclose(np.concatenate([alone([file], "first") for file in frames]), together, atol=1e-6)


def test_an_image_passes_once_for_all_outputs_orders_and_processes(embed, frames, passes):
    first, second = embed(frames, "first"), embed(frames, "second")
    assert sum(passes) == 19 and max(passes) <= 8
    other = again(embed)
    np.testing.assert_array_equal(other([*frames[::-1], *frames], "first"), np.concatenate([first[::-1], first]))
    np.testing.assert_array_equal(other(frames, "second"), second)
    assert sum(passes) == 19


def test_equal_pixels_are_one_image_whatever_the_file(embed, frames, passes, tmp_path):
    embed(frames, "first")
    copy = shutil.copy(frames[0], tmp_path / "copy.png")
    np.testing.assert_array_equal(again(embed)([copy], "first"), embed(frames[:1], "first"))
    assert sum(passes) == 19


def test_changed_pixels_pass_again_and_only_they(embed, frames, passes):
    before = embed(frames, "first")
    image = read_rgb(frames[3])
    image[0, 0] = 1 - image[0, 0]
    write_png(frames[3], image)
    passes.clear()
    after = again(embed)(frames, "first")
    assert passes == [1]
    assert np.flatnonzero((before != after).any(axis=1)).tolist() == [3]


@pytest.mark.parametrize(
    "changes",
    [{"identity": "other weights"}, {"prepare": Preprocessing((0.5,) * 3, (0.5,) * 3, "center", size=16)}],
)
def test_other_weights_or_preprocessing_find_nothing(embed, frames, passes, changes):
    embed(frames, "first")
    passes.clear()
    again(embed, **changes)(frames[:2], "first")
    assert passes == [2]


def test_a_deleted_or_damaged_cache_is_filled_again(embed, frames, passes, tmp_path):
    before = embed(frames, "first")
    for i, file in enumerate((tmp_path / "embeddings/linear/first").rglob("*.npy")):
        file.write_bytes(file.read_bytes()[: 50 * (i % 4)])
    np.testing.assert_array_equal(again(embed)(frames, "first"), before)
    shutil.rmtree(tmp_path / "embeddings")
    np.testing.assert_array_equal(again(embed)(frames, "first"), before)
    assert sum(passes) == 3 * 19


def test_filling_first_gives_the_same(embed, frames, passes):
    embed.fill([*frames, *frames], "first")
    assert sum(passes) == 19
    embed(frames, "first")
    assert sum(passes) == 19


def test_parts_of_a_digest_are_kept_apart():
    array = np.arange(6, dtype=np.uint8)
    digests = [
        digest_of("ab", "c"), digest_of("a", "bc"), digest_of("abc"), digest_of(array), digest_of(array.reshape(2, 3)),
        digest_of(array.astype(np.int8)), digest_of(array[::-1]), digest_of(),
    ]  # fmt: skip
    assert len(set(digests)) == len(digests)
    assert digest_of(array[::2]) == digest_of(array[::2].copy())


WRITER = """
import sys, numpy as np
from pathlib import Path
from evaluation.metrics.networks.embedding_cache import EmbeddingCache, digest_of
cache = EmbeddingCache(Path(sys.argv[1]))
for turn in range(30):
    for i in range(10):
        cache.put("net", digest_of(str(i)), np.full(5000, i, np.float32))
"""


def test_processes_that_write_at_once_never_show_a_part(tmp_path):
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    cache, seen = EmbeddingCache(tmp_path), 0
    with started(command) as one, started(command) as other:
        while one.poll() is None or other.poll() is None:
            for i in range(10):
                found = cache.get("net", digest_of(str(i)))
                assert found is None or (found.shape == (5000,) and (found == i).all())
                seen += found is not None
        assert one.returncode == other.returncode == 0 and seen
    assert not list(tmp_path.rglob("*.part*"))
