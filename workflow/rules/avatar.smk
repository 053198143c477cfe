"""From a capture to an avatar.

`watch` and `watch_targets` are the folders whose files an index lists: inputs, so that a change in them causes a re-run.
"""


rule track:
    input:
        settings="results/{study}/settings/track/subject={subject}.yaml",
    output:
        dataset=directory("results/{study}/{subject}/tracked"),
    log:
        "results/{study}/log/track/{subject}.log",
    conda:
        "../../environment.yml"
    threads: 2
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("track", "subject"),
    script:
        "../scripts/stage.py"


rule capture:
    input:
        settings="results/{study}/settings/capture/subject={subject}.yaml",
        tracked=tracked_video,
    output:
        index="results/{study}/{subject}/capture.json",
        dataset=directory("results/{study}/{subject}/dataset"),
    log:
        "results/{study}/log/capture/{subject}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("capture", "subject"),
    script:
        "../scripts/stage.py"


rule hair:
    input:
        settings="results/{study}/settings/hair/subject={subject}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
    output:
        found="results/{study}/{subject}/hair.npz",
    log:
        "results/{study}/log/hair/{subject}.log",
    conda:
        "../../environment.yml"
    threads: 2
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("hair", "subject"),
    script:
        "../scripts/stage.py"


rule exaggerate:
    input:
        settings="results/{study}/settings/exaggerate/subject={subject},gamma={gamma}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
    output:
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
    log:
        "results/{study}/log/exaggerate/{subject},gamma={gamma}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("exaggerate", "subject", "gamma"),
    script:
        "../scripts/stage.py"


rule gtstar:
    input:
        settings="results/{study}/settings/gtstar/subject={subject},variant={variant}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
        hair="results/{study}/{subject}/hair.npz",
    output:
        targets=directory("results/{study}/{subject}/gamma={gamma}/targets/{variant}/level={level}/images"),
        index="results/{study}/{subject}/gamma={gamma}/targets/{variant}/level={level}/targets.json",
    log:
        "results/{study}/log/gtstar/{subject},gamma={gamma},{variant},level={level}.log",
    priority: 1  # uses several threads, so it should not wait for a free core behind trainings
    conda:
        "../../environment.yml"
    threads: 2
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("gtstar", "subject", "variant"),
        level=level,
    script:
        "../scripts/stage.py"


rule target_sheet:
    input:
        settings="results/{study}/settings/target_sheet/subject={subject}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
        watch_targets="results/{study}/{subject}/gamma={gamma}/targets/{variant}/level={level}/images",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
        index="results/{study}/{subject}/gamma={gamma}/targets/{variant}/level={level}/targets.json",
    output:
        sheet="results/{study}/{subject}/gamma={gamma}/targets/{variant}/level={level}/inspection.png",
    log:
        "results/{study}/log/target_sheet/{subject},gamma={gamma},{variant},level={level}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("target_sheet", "subject"),
        level=level,
    script:
        "../scripts/stage.py"


rule train:
    input:
        settings="results/{study}/settings/train/subject={subject},variant={variant},seed={seed}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
        watch_targets=targets("results/{study}/{subject}/gamma={gamma}/targets/{maker}/level={level}/images"),
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
        hair="results/{study}/{subject}/hair.npz",
        targets=targets("results/{study}/{subject}/gamma={gamma}/targets/{maker}/level={level}/targets.json"),
    output:
        avatar="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.npz",
        ply="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.ply",
        log="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/log.csv",
    log:
        "results/{study}/log/train/{subject},gamma={gamma},{variant},seed={seed}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 6000 * attempt,
    params:
        plan=plan("train", "subject", "variant", "seed"),
    script:
        "../scripts/stage.py"


rule html:
    input:
        settings="results/{study}/settings/html/subject={subject}.yaml",
        avatar="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.npz",
    output:
        page="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.html",
    log:
        "results/{study}/log/html/{subject},gamma={gamma},{variant},seed={seed}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("html", "subject"),
        title="{study}: {subject}, {variant}",
    script:
        "../scripts/stage.py"


rule render:
    input:
        settings="results/{study}/settings/render/subject={subject},gamma={gamma}.yaml",
        avatar="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.npz",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
    output:
        frames=directory("results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/frames"),
    log:
        "results/{study}/log/render/{subject},gamma={gamma},{variant},seed={seed}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("render", "subject", "gamma"),
    script:
        "../scripts/stage.py"
