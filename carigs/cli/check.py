"""`carigs check`: validate a dataset in the layout of GaussianAvatars or VHAP.

Everything that is wrong is found in one pass, and printed with file, field and remedy: errors, which the stage capture
refuses, then warnings. The posed mesh is compared with the mattes of each camera. If it does not fit, the usual
mistakes (units, axes, intrinsics, mirrored images, shifted frames) are tried, and the one that mends it is named.

Exit code: 0 if there are no errors, 1 if there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from carigs.capture import Capture, read_dataset
from carigs.cli.options.parser import command_parser
from carigs.errors import InputError, collecting, printable
from carigs.plausibility import resolve_cy
from carigs.plausibility.check import Examination, examine_capture
from carigs.plausibility.coverage import capture_coverage, lost_camera
from carigs.plausibility.diagnosis.principal_point_shift import principal_point_shift
from carigs.plausibility.diagnosis.reprojection import Reprojection, total_overlap
from carigs.plausibility.faults import Fault, error_faults, finding_faults

EXAMPLES = """examples:
  carigs check data/306 --head-model flame2023.pkl
  carigs check data/306 --head-model flame2023.pkl --sheet sheet.png     the mesh over some frames
"""
SHOWN = 3
"""Places that are listed of each fault."""


def check(folder: Path, head_model: Path, *, background: float, split: str, sheet: Path | None) -> int:
    """Validate a dataset and print what is wrong with it.

    Args:
        folder: The dataset.
        head_model: File of its head model.
        background: Grey value of the images' background.
        split: How frames are divided into splits.
        sheet: PNG to write, if any.

    Returns:
        Number of errors.

    Raises:
        InputError: If there is no such folder or head model.
    """
    errors: list[InputError] = []
    capture = read_dataset(folder, head_model, background=background, split=split, errors=errors)
    if not capture.frames:
        print(*report(error_faults(errors, folder), "errors"), "no frame is left to compare with the head", sep="\n")
        return len(errors)
    capture, examination = _examine(capture, errors)
    diagnosis, cameras = examination.diagnosis, len(capture.cameras)
    print(f"{len(capture.frames)} frames, {len(capture.parameter_files)} timesteps, {cameras} cameras")
    print(f"cy is read as {capture.cy}")
    print(*report(error_faults(errors, folder), "errors"), sep="\n")
    warnings = [Fault(line, (), "") for line in capture.warnings]
    warnings += finding_faults([*examination.findings, *filter(None, [lost_camera(capture)])], folder)
    warnings += [] if diagnosis.mistakes else _half_pixel(capture)
    print(*report(warnings, "warnings"), sep="\n")
    if not errors and not diagnosis.mistakes and (coverage := capture_coverage(capture)):
        print(coverage)
    if diagnosis.stated.overlaps:
        print(*table(diagnosis.stated), sep="\n")
    if sheet is not None:
        from evaluation.figures.overlay_sheet import overlay_sheet

        overlay_sheet(sheet, capture)
        print(sheet)
    return len(errors)


def _examine(capture: Capture, errors: list[InputError]) -> tuple[Capture, Examination]:
    """Read cy in the convention that fits, and find what is wrong; other mistakes may hide the convention."""
    undecided: list[InputError] = []
    resolved = capture
    with collecting(undecided):
        resolved = resolve_cy(capture)
    found: list[InputError] = []
    examination = examine_capture(resolved, found, always_diagnose=True)
    if resolved.calibrations != capture.calibrations and examination.diagnosis.mistakes:
        resolved, found = capture, []
        examination = examine_capture(capture, found, always_diagnose=True)
    elif not examination.diagnosis.mistakes:
        found += undecided
    errors += found
    return resolved, examination


def report(faults: Sequence[Fault], heading: str) -> Iterator[str]:
    """Describe faults.

    Args:
        faults: The faults.
        heading: What they are: errors or warnings.

    Yields:
        Lines.
    """
    count = sum(max(len(fault.places), 1) for fault in faults)
    yield f"{heading}: {count or 'none'}"
    for problem, places, remedy in faults:
        yield printable(f"  {problem}" + (f" ({len(places)} times)" if len(places) > 1 else ""))
        yield from (printable(f"    {place}") for place in places[:SHOWN])
        if len(places) > SHOWN:
            yield f"    ... and {len(places) - SHOWN} more"
        if remedy:
            yield f"    remedy: {remedy}"


def table(reprojection: Reprojection) -> Iterator[str]:
    """Describe how well the silhouette of the mesh fits the mattes.

    Args:
        reprojection: The comparison.

    Yields:
        A line per camera, and one for all.
    """
    yield f"reprojection: silhouette of the mesh against the mattes of {len(reprojection.overlaps)} frames"
    yield "  camera    IoU   mesh outside matte   matte off mesh"
    numbers = sorted({shot.frame.camera for shot in reprojection.overlaps})
    for name, members in {**{f"{n}": {n} for n in numbers}, "all": set(numbers)}.items():
        overlap = total_overlap(o for shot, o in reprojection.overlaps.items() if shot.frame.camera in members)
        yield f"  {name:>6}  {overlap.iou:5.3f}   {overlap.outside_share:18.1%}   {overlap.uncovered_share:14.1%}"


def _half_pixel(capture: Capture) -> list[Fault]:
    """The principal point is off by half a pixel; only the colours of the cameras tell."""
    measured = principal_point_shift(capture)
    if not measured.half_pixel:
        return []
    (x, y), (dx, dy) = measured.shift, measured.error
    problem = f"the principal point is off by half a pixel: ({x:+.2f} +- {dx:.2f}, {y:+.2f} +- {dy:.2f}) fit best"
    return [Fault(problem, (), f"cx, cy: add {measured.half_pixel:+g} (pixel centres lie at +0.5)")]


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("check", __doc__, EXAMPLES)
    parser.add_argument("folder", type=Path, help="the dataset: the folder of transforms_train.json")
    parser.add_argument("--head-model", type=Path, required=True, metavar="FILE", help="its head model: .npz or .pkl")
    parser.add_argument("--sheet", type=Path, metavar="PNG", help="draw the mesh over some of the frames")
    parser.add_argument(
        "--background", type=float, default=1.0, metavar="GREY", help="of the images, 0 to 1 (default %(default)s)"
    )
    parser.add_argument(
        "--split",
        default="files",
        help="files, released, blocks, or the test sequence (default %(default)s)",
    )
    task = parser.parse_args(arguments)
    errors = check(task.folder, task.head_model, background=task.background, split=task.split, sheet=task.sheet)
    return 1 if errors else 0
