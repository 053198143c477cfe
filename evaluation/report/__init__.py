"""The report of a study: one HTML file with card, images by level, figures, training curves, tables, gaps and settings.

- `images`: images as data URIs
- `training_chart`: PSNR against seconds as SVG
- `page`: the page, from a template (`page.html.jinja`, `page.css`, `page.js`)

Nothing is re-exported: `page` imports jinja2.
"""
