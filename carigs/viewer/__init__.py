"""The interactive web viewer, which `carigs view` starts.

- `state`: the controls, their values, undo
- `scene`: surfels of an avatar for values of the controls
- `splat_records`, `exact_mode`, `overlays`, `comparison`: what the browser shows
- `exports`: files that the page asks for
- `subject`: the avatars, their capture, and the truth
- `options`, `page`, `session`: what one client looks at, its page, and what it must be shown next
- `panel`, `server`, `admission`: the page in viser, the server, and what it takes from clients

Modules are imported directly: only the last three import viser, which the extra `viewer` installs.
"""
