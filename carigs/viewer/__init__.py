"""Viewers of an avatar: the page that `carigs view` serves, and the avatar as one HTML file.

- `html`: `write_html`, an avatar as one HTML file that needs neither a server nor a network
- `state`: the controls, their values, undo
- `scene`: surfels of an avatar for values of the controls
- `splat_records`, `exact_mode`, `overlays`, `comparison`: what the browser shows
- `exports`: files that the page asks for
- `subject`: the avatars, their capture, and the truth
- `options`, `page`, `session`: what one client looks at, its page, and what it must be shown next
- `listening`, `admission`: the socket, and which requests are answered
- `panel`, `server`, `client_messages`: the page in viser, the server, and what it takes from clients

Modules are imported directly, so that no module loads more than it needs: only the last three import viser, which the
extra `viewer` installs.
"""
