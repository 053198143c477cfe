"""The figures of a study.

- `strips`: a variant over the levels, and the ablation sheet
- `blend_error`: error of the linear blend and of the stored path (figure 2 of the paper)
- `misregistration`: error of GT* targets by region and level
- `target_sheet`: contact sheet of a subject's targets
- `surface_gallery`: presets of the exaggeration on meshes
- `png_figure`, `sheet`, `clay`: how figures, sheets of images and meshes are drawn
"""
