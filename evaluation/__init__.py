"""How good it is: metrics on images and embeddings, tables with intervals, figures.

- `image`, `regions`, `against_truth`: PSNR and SSIM against true images, by region
- `clip`, `dino`, `preprocessing`, `embeddings`, `weights`: scores on embeddings, and the networks that make those
- `rows`, `listings`: metric rows and image indices on disk
- `bootstrap`, `table`, `typeset`: means with intervals, as CSV, Markdown and LaTeX
- `sheet`, `strips`, `blend_error`: figures
"""
