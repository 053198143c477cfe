"""Time of `carigs view` from a moved slider to what is sent to the browser.

Example:
    python -m evaluation.benchmarks.viewer results/benchmark/viewer.csv toy=AVATAR.npz ict_s1=AVATAR.npz
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import count

import carigs
from carigs.library import HeadAvatar
from carigs.viewer.controls import controls_of
from carigs.viewer.exact_mode import exact_image
from carigs.viewer.scene import HeadScene
from carigs.viewer.splat_records import splat_records
from carigs.viewer.state import State
from evaluation.benchmarks.measurement.kernel_timing import num_threads
from evaluation.benchmarks.measurement.timing import Measurement, cpu_seconds, median_time, write_measurements
from evaluation.command_line import csv_parser, run

SIZE = (275, 401)
"""Height and width of an image in pixels."""
REPEATS = 15


def measure(avatars: Mapping[str, HeadAvatar], repeats: int = REPEATS) -> Iterator[Measurement]:
    """Measure a change of the exaggeration, without shading, which follows when nothing moves.

    Args:
        avatars: Avatars by name.
        repeats: Number of timed changes.

    Yields:
        CPU time of one thread from a new level to records of the surfels; wall time from a new level to an exact image
        with two threads.
    """
    for name, avatar in avatars.items():
        scene, values = HeadScene(avatar), State(controls_of(avatar)).values
        (camera,) = carigs.orbit(avatar, 1, size=SIZE)
        levels = (avatar.gamma * (0.4 + 0.001 * i) for i in count())
        case = f"{name}: {len(avatar.avatar.surfels)} surfels, {len(avatar.avatar.sequence.head.faces)} triangles"

        def moved(scene=scene, values=values, levels=levels, camera=camera):
            return scene.surfels({**values, "level": next(levels)}, camera.centre, settled=False)

        with num_threads(1):
            clock = partial(median_time, repeats=repeats, clock=cpu_seconds)
            yield Measurement(case, "gamma change to records", "CPU ms", 1e3 * clock(lambda: splat_records(moved())))
        with num_threads(2):
            image = partial(median_time, repeats=repeats)
            seconds = image(lambda camera=camera: exact_image(moved(), camera, 1.0))
            yield Measurement(case, f"gamma change to an exact image of {SIZE[1]} x {SIZE[0]}", "ms", 1e3 * seconds)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("avatars", nargs="+", metavar="NAME=AVATAR", help="name and file of each avatar")
    arguments = parser.parse_args()
    named = (text.partition("=") for text in arguments.avatars)
    write_measurements(arguments.rows, measure({name: carigs.load(file) for name, _, file in named}))


if __name__ == "__main__":
    run(main)
