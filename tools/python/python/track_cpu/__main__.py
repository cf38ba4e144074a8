"""The command line: python -m track_cpu {demo,track}."""

import argparse
import sys
import time

from . import FlightTracker, ModelError, Tracker, __version__, _frames, builtin_models, demo


def main(arguments=None):
    """Runs a sub-command; returns the exit code: 0, 2 for bad arguments, 3 for bad input."""
    args = parser().parse_args(arguments)
    try:
        args.run(args)
    except BrokenPipeError:
        sys.stderr.close()  # or Python would complain about the pipe once more
        return 0
    except (ImportError, OSError, ModelError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 3
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def parser():
    top = argparse.ArgumentParser(
        prog="python -m track_cpu", description="Follows one object through video on a CPU."
    )
    top.add_argument("--version", action="version", version=f"track-cpu {__version__}")
    commands = top.add_subparsers(required=True, metavar="COMMAND")

    shown = commands.add_parser("demo", help="track a rendered flight and say how well it went")
    shown.add_argument("--frames", type=int, default=300, metavar="N", help="[default: 300]")
    shown.add_argument("--seed", type=int, default=7, metavar="N", help="[default: 7]")
    shown.add_argument("--difficulty", choices=("easy", "medium", "hard"), default="easy")
    shown.set_defaults(run=run_demo)

    tracked = commands.add_parser("track", help="track an object through a video or images")
    tracked.add_argument("input", help="video file (needs opencv-python) or folder of images")
    tracked.add_argument(
        "--init",
        type=box,
        required=True,
        metavar="X,Y,W,H",
        help="the object in the first picture: left, top, width, height in pixels",
    )
    tracked.set_defaults(run=run_track)

    for command in (shown, tracked):
        names = ", ".join(builtin_models)
        command.add_argument(
            "--model",
            default=builtin_models[0],
            metavar="FILE|NAME",
            help=f"weights file, or a built-in model: {names} [default: {builtin_models[0]}]",
        )
        command.add_argument("--mode", choices=("plain", "flight"), default="plain")
        command.add_argument("--precision", choices=("f32", "int8"))
        command.add_argument("--threads", type=int, default=1, metavar="N", help="[default: 1]")
        command.add_argument("--as-published", action="store_true")
    return top


def box(text):
    """A box from X,Y,W,H."""
    try:
        x, y, w, h = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}, expected X,Y,W,H in pixels") from None
    return x, y, w, h


def make(args, order):
    kind = FlightTracker if args.mode == "flight" else Tracker
    return kind(
        args.model,
        precision=args.precision,
        threads=args.threads,
        as_published=args.as_published,
        order=order,
    )


def run_demo(args):
    summary = demo.run(
        args.frames, seed=args.seed, difficulty=args.difficulty, tracker=make(args, "rgb")
    )
    print(
        f"{args.difficulty} flight {args.seed}, {summary.frames} frames: "
        f"mean IoU {summary.mean_iou:.3f}, {summary.fps:.0f} FPS on the CPU"
    )


def run_track(args):
    """Prints x,y,w,h for every picture; in flight mode presence and state as well."""
    tracker = make(args, "bgr")
    flies = args.mode == "flight"
    count, seconds = 0, 0.0
    for image in _frames.read(args.input):
        started = time.perf_counter()
        if count == 0:
            tracker.init(image, args.init)
            found = args.init
        else:
            _, found = tracker.update(image)
            seconds += time.perf_counter() - started
        line = ",".join(f"{number:.3f}" for number in found)
        if flies:
            line += f",{tracker.presence:.4f},{tracker.state}"
        print(line, flush=True)
        count += 1
    if count > 1:
        print(f"{count} frames: {(count - 1) / seconds:.1f} FPS tracking", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
