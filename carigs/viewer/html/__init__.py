"""An avatar as one HTML file: a page that poses, exaggerates, sorts and draws the surfels in the browser.

- `page`: `write_html`, the page with its scripts (`page.*.js`), shaders (`page.*.vert`, `.frag`) and data
- `packed_arrays`: arrays as whole numbers in planes of bytes, which deflate well
- `low_rank`: rows of numbers as sums of a few, in whole numbers
- `head_arrays`: the mesh, its clip and its caricatures; `light_arrays`: the light on it; `surfel_arrays`: the surfels

Modules are imported directly: this package imports nothing, so that no module loads more than it needs.
"""
