"""The figures of a study.

- `study_images`: the rendered and true images of a subject
- `strips`: levels, baseline and ablations beside each other (figures 5, 7 and 10 to 12 of the paper)
- `hair`: the part of an image that shows the hair
- `local_edits`: one region exaggerated at a time (figure 4)
- `blend_error`: error of the linear blend and of the stored path (figure 3)
- `misregistration`: error of GT* targets by region and level (figure 9)
- `target_sheet`, `overlay_sheet`: contact sheets of targets and of a capture
- `style`, `png_figure`, `sheet`, `clay`: how figures, sheets of images and meshes are drawn
"""
