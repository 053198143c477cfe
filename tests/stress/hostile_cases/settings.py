"""YAML of settings, and overrides of them."""

from __future__ import annotations

from collections.abc import Iterator

from stress.hostile_cases.case import Case


def wrong_yaml(sound: bytes) -> Iterator[Case]:
    """Broken, hostile and incomplete files of settings.

    Args:
        sound: A sound file.

    Yields:
        The cases.
    """
    bomb = b"a: &a [x,x,x,x,x,x,x,x,x]\n"
    for before, name in zip(b"abcdefgh", b"bcdefghi", strict=True):
        bomb += b"%c: &%c [%s]\n" % (name, name, b",".join([b"*%c" % before] * 9))
    texts = (
        bomb, b"3", b"- 1", b"", b"null", b"a: 1\na: 2", b"iterations: !!python/name:os.system x", sound + b"\nx: 1\n",
        sound + sound, sound + b"---\n" + sound, b"seed: " + b"[" * 10**5, b"seed: " + b"{a: " * 50_000,
        sound.decode().encode("utf-16"),
        b"? [1]\n: 2", b"seed: '", b"\x00", b"%YAML 9.9\n---\n" + sound, b"<<: {seed: 1}", b"seed: 0x" + b"f" * 400,
        sound.replace(b"seed: 0", b"seed: " + b"9" * 5000), sound.replace(b"seed: 0", b"seed: 1e400"),
        sound.replace(b"seed: 0", b"seed: .nan"), sound.replace(b"seed: 0", b"seed: [0]"), sound[: len(sound) // 2],
        sound.replace(b"seed: 0", b"seed: ${seed}"), sound.replace(b"seed: 0", b"seed: ${oc.env:HOME}"),
        sound.replace(b"initial_opacity: 0.6", b"initial_opacity: .inf"), sound.replace(b"initial_opacity: 0.6",
        b"initial_opacity: 1:30"),
        b"# x\n" * 10**6, b"a: &a [*a]",
    )  # fmt: skip
    for i, text in enumerate(texts):
        yield Case(f"{i}: {text[:30]!r}", "settings", text, must_fail=True)


def wrong_overrides() -> Iterator[Case]:
    """Overrides with values that no setting can have, and of what is no setting.

    Yields:
        The cases.
    """
    keys = (
        "gamma", "study.name", "study.levels", "study.subjects", "capture.source", "capture.background",
        "capture.toy.width", "exaggerate.regions", "exaggerate.path_nodes", "gtstar.hair_extinction",
        "train.iterations", "train.position_lr",
        "train.mask_flags", "train.density.stop", "metrics.edit_prompt", "figures.camera", "tabulate.reference",
    )  # fmt: skip
    values = (
        "nan", "inf", "-inf", "1e400", "-1e308", "9" * 400, "9" * 5000, "[[1]]", "{a:{b:1}}", "''", "${oc.env:HOME}",
        "${oc.decode:x}", "${gamma}", "${missing}", "!!python/name:os.system", "[" * 40, "'", "a b", "../../x", "\\\\",
    )  # fmt: skip
    for key in keys:
        for value in values:
            number = not key.startswith(("study.name", "study.subjects", "capture.source", "metrics"))
            never = value in ("nan", "inf", "1e400", "[[1]]", "{a:{b:1}}", "9" * 400) and number
            yield Case(f"{key}={value[:30]}", "override", f"{key}={value}".encode(), must_fail=never)
    for text in (
        "hydra.searchpath=[pkg://antigravity]", "+hydra.searchpath=[file:///]", "hydra/launcher=basic",
        "hydra.run.dir=elsewhere",
        "~train", "+x=1", "++train.iterations=1", "=1", "", "train", "train={}", "train=null", "train.seed=1",
        "train.seed", "seed=1", "@x=1", "study.seeds=[1,1]", "study.seeds=[-1]",
        "subject@y=toy", "study=../../../etc/passwd", "study=/etc/passwd", "exaggerate=[robust,paper]", "\0=1", "a=\0",
        "train.iterations=1,2", "train.iterations=range(9)", "train.iterations=choice(1,2)", "study=${oc.env:HOME}",
        "train.iterations=int('1')",
        "capture={source:folder}", "capture.source=folder", "train.iterations=json_str('1')", "gamma=0.1 gamma=0.2",
    ):  # fmt: skip
        allowed = text in ("train={}", "exaggerate=[robust,paper]", "train.iterations=int('1')")
        yield Case(text[:40], "override", text.encode(), must_fail=not allowed)
