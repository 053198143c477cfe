"""Evaluation of avatars: metrics, tables, figures, benchmarks and stress tests.

- `metrics`: PSNR and SSIM against true images, CLIP-I, CLIP-D, CLIP-C and DINO
- `tables`: means with confidence intervals, as CSV, Markdown and LaTeX (table 1 of the paper)
- `figures`: the figures of a study
- `benchmarks`: time and accuracy of the parts
- `stress`: broken meshes, and invariants on real heads
- `command_line`: command lines of the benchmarks and stress tests
"""
