"""Pictures of the pages in a browser.

- `chromium`: `Browser`, Chromium without a window
- `pages`: screenshots of the HTML page of an avatar and of the viewer
"""
