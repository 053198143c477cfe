"""Random damage of files: what a broken disk, a cut-off copy or an attacker does to them."""

from __future__ import annotations

from hypothesis import strategies as st


@st.composite
def damaged(draw: st.DrawFn, content: bytes, others: tuple[bytes, ...] = ()) -> bytes:
    """The content truncated, with flipped bits, replaced bytes, a repeated part, or a part of another file."""
    result = bytearray(content)
    for _ in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(("truncate", "flip", "replace", "repeat", "splice")))
        at = draw(st.integers(0, max(len(result) - 1, 0)))
        if kind == "truncate":
            del result[at:]
        elif kind == "flip" and result:
            result[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "replace":
            new = draw(st.binary(max_size=8))
            result[at : at + len(new)] = new
        elif kind == "repeat":
            length = draw(st.integers(1, 64))
            result[at:at] = result[at : at + length] * draw(st.integers(1, 4))
        elif others:
            source = draw(st.sampled_from(others))
            start = draw(st.integers(0, max(len(source) - 1, 0)))
            result[at : at + 64] = source[start : start + 64]
    return bytes(result)
