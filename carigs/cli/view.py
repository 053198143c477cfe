"""`carigs view`: a trained avatar in the browser, with a slider for everything that can be changed.

The page is served at this machine alone unless --host says otherwise: there is no password. For another machine,
forward the port: ssh -L 8080:localhost:8080 MACHINE. docs/viewer.md describes the page.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.cli.options.motion import add_motion_options, driver_of, named_motions
from carigs.cli.options.parser import command_parser
from carigs.errors import CarigsError, InputError, SettingsError
from carigs.system.extras import need

if TYPE_CHECKING:
    from carigs.viewer.listening import Listener

EXAMPLES = """examples:
  carigs view avatar.npz
  carigs view avatar.npz other.npz                          two avatars side by side, with a divider
  carigs view avatar.npz --motion take.csv                  the head follows a motion
  carigs view avatar.npz --capture results/toy/toy/capture.json
"""


def view(task: argparse.Namespace) -> None:
    """Start the viewer, and serve until it is interrupted.

    Args:
        task: The command line.

    Raises:
        InputError: For files that cannot be read.
        PackageMissing: If viser is not installed.
        SettingsError: If the viewer cannot listen.
    """
    if task.truth is not None and task.capture is None:
        raise SettingsError("--truth needs --capture")
    if task.exports.exists() and not task.exports.is_dir():
        raise InputError("is no folder", file=task.exports)
    need("viser")
    from carigs.viewer.listening import listen

    listener = listen(task.host, task.port, task.allowed_hosts)  # first: a mistake ends the command at once
    with contextlib.closing(listener.socket):
        _serve(task, listener)


def _serve(task: argparse.Namespace, listener: Listener) -> None:
    from rich.progress import track

    from carigs.capture import Capture
    from carigs.library import load
    from carigs.viewer.server import Viewer
    from carigs.viewer.subject import Subject

    avatar, second = load(task.avatar), None if task.second is None else load(task.second)
    capture = None if task.capture is None else Capture.load(task.capture)
    driver = driver_of(task)
    motions = named_motions(task.motions, task, driver, None)
    viewer = Viewer(Subject(avatar, second, capture, task.truth, motions, driver), task.exports, listener)
    try:
        print(f"open {listener.address} in a browser; Ctrl-C ends the viewer", flush=True)
        regions = [control.label for control in viewer.subject.controls if control.group == "regions"]
        for name in track(regions, "solving regions", transient=True, disable=not sys.stderr.isatty()):
            for scene in viewer.subject.scenes:
                if name in scene.avatar.regions:
                    with contextlib.suppress(CarigsError):  # the page says so when its slider is moved
                        scene.solve_region(name)
        viewer.wait()
    except KeyboardInterrupt:
        print("ended")
    finally:
        viewer.stop()


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("view", __doc__, EXAMPLES)
    parser.add_argument("avatar", type=Path, metavar="AVATAR", help="the avatar (.npz)")
    parser.add_argument("second", type=Path, metavar="AVATAR2", nargs="?", help="another one to compare it with")
    parser.add_argument("--capture", type=Path, metavar="FILE", help="capture.json: its cameras and images")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="truth.json: images of a caricature to compare with")
    parser.add_argument(
        "--exports", type=Path, default=Path("exports"), metavar="FOLDER", help="where exports go (default %(default)s)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (default %(default)s)")
    parser.add_argument("--port", type=int, help="port to listen at, 0 for any (default: 8080, or the next free one)")
    parser.add_argument(
        "--allow-host", dest="allowed_hosts", action="append", default=[], metavar="NAME",
        help="another name by which browsers reach the viewer, such as that of a proxy",
    )  # fmt: skip
    parser.add_argument(
        "--motion", dest="motions", action="append", default=[], metavar="[NAME=]FILE",
        help="a motion that can drive the head, besides idle and talk",
    )  # fmt: skip
    add_motion_options(parser)
    view(parser.parse_args(arguments))
    return 0
