"""CLIP-I, CLIP-D, CLIP-C and DINO similarity: identities on vectors."""

import numpy as np

from evaluation.metrics.networks import clip
from evaluation.metrics.networks.dino import dino_similarity


def unit(*shape, seed=0):
    vectors = np.random.default_rng(seed).normal(size=shape)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_the_cosine_with_the_prompt_itself_is_one_and_its_score_two_and_a_half():
    text = unit(8)
    images = np.stack([text, -text])
    np.testing.assert_allclose(clip.clip_i(images, text), [1, -1])
    np.testing.assert_allclose(clip.clip_i_score(images, text), [2.5, 0])


def test_a_shift_along_the_change_of_the_prompt_has_direction_one():
    original, source, edit = unit(5, 8), unit(8, seed=1), unit(8, seed=2)
    shifted = original + 0.3 * (edit - source)
    np.testing.assert_allclose(clip.clip_d(shifted, original, edit, source), 1)


def test_swapping_one_pair_negates_the_direction_and_swapping_both_keeps_it():
    a, b, source, edit = unit(5, 8), unit(5, 8, seed=3), unit(8, seed=1), unit(8, seed=2)
    plain = clip.clip_d(a, b, edit, source)
    np.testing.assert_allclose(clip.clip_d(b, a, edit, source), -plain)
    np.testing.assert_allclose(clip.clip_d(b, a, source, edit), plain)


def test_no_change_has_direction_zero_rather_than_nan():
    a, source, edit = unit(5, 8), unit(8, seed=1), unit(8, seed=2)
    assert (clip.clip_d(a, a, edit, source) == 0).all()
    assert (clip.clip_d(a, unit(5, 8, seed=3), edit, edit) == 0).all()


def test_consistency_of_identical_frames_is_one_and_the_same_backwards():
    np.testing.assert_allclose(clip.clip_c_adjacent(np.tile(unit(8), (5, 1))), 1)
    frames = unit(6, 8)
    assert len(clip.clip_c_adjacent(frames)) == 5
    np.testing.assert_allclose(clip.clip_c_adjacent(frames[::-1])[::-1], clip.clip_c_adjacent(frames))


def test_consistency_follows_the_order_of_the_frames():
    angles = np.radians([0, 10, 30])
    frames = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    np.testing.assert_allclose(clip.clip_c_adjacent(frames), np.cos(np.radians([10, 20])))


def test_an_edit_that_is_the_same_in_every_frame_is_consistent_in_both_directions():
    original, shift = unit(6, 8), unit(8, seed=1)
    edited = original + shift
    np.testing.assert_allclose(clip.clip_c_dir_edit(edited, original), 1)
    np.testing.assert_allclose(clip.clip_c_dir_motion(edited, original), 1)


def test_alternating_edits_are_opposite_and_a_reversed_motion_too():
    original, shift = unit(6, 8), unit(8, seed=1)
    signs = np.resize([1, -1], (6, 1))
    np.testing.assert_allclose(clip.clip_c_dir_edit(original + signs * shift, original), -1)
    np.testing.assert_allclose(clip.clip_c_dir_motion(-original, original), -1)


def test_directions_do_not_depend_on_the_direction_of_time_nor_on_the_size_of_the_edit():
    original, edited = unit(6, 8), unit(6, 8, seed=2)
    larger = original + 3 * (edited - original)
    for consistency in (clip.clip_c_dir_edit, clip.clip_c_dir_motion):
        forwards = consistency(edited, original)
        np.testing.assert_allclose(consistency(edited[::-1], original[::-1])[::-1], forwards, atol=1e-12)
    np.testing.assert_allclose(clip.clip_c_dir_edit(larger, original), clip.clip_c_dir_edit(edited, original))


def test_frames_without_an_edit_or_a_motion_have_direction_zero_and_their_own_motion_one():
    frames, still = unit(6, 8), np.tile(unit(8), (6, 1))
    assert (clip.clip_c_dir_edit(frames, frames) == 0).all()
    np.testing.assert_allclose(clip.clip_c_dir_motion(frames, frames), 1)
    assert (clip.clip_c_dir_motion(frames, still) == 0).all()


def test_rendered_and_original_frames_are_compared_one_by_one():
    frames, others = unit(4, 8), unit(4, 8, seed=1)
    np.testing.assert_allclose(clip.clip_i_image(frames, frames), 1)
    np.testing.assert_allclose(clip.clip_i_image(frames, others), [a @ b for a, b in zip(frames, others, strict=True)])


def test_dino_similarity_compares_frame_by_frame():
    frames = unit(4, 8)
    np.testing.assert_allclose(dino_similarity(frames, frames), 1)
    np.testing.assert_allclose(dino_similarity(frames, -frames), -1)
