"""The interactive web viewer, which `carigs view` starts.

- `state`: the controls, their values, undo
- `scene`: surfels of an avatar for values of the controls
- `splat_records`, `exact_mode`, `overlays`: what the browser shows
- `exports`: files that the page asks for
- `session`, `panel`, `server`: one client, its controls on the page, and the server

Modules are imported directly: only `panel` and `server` import viser, which the extra `viewer` installs.
"""
