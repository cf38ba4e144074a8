#!/usr/bin/env python3
"""From glass to box: how long after a picture was taken `track-cpu serve` reports its box.

    tests/latency.py target/release/track-cpu [--only NAME] [--seconds 20] [-- OPTIONS OF SERVE]

The camera is made here: a target goes round on a circle, one place per frame, so that a box, or a
picture of the video that comes out, tells which frame it belongs to. A frame's time begins when it
is handed to the camera's encoder, and ends when its JSON line arrives by UDP; for video out, when
the picture with the box is decoded. Camera, encoder, tracker and receiver share this machine.

Needs GStreamer's gst-launch-1.0 with x264enc and avdec_h264, for RTSP gst-rtsp-server with its
Python binding (Debian: gir1.2-gst-rtsp-server-1.0, python3-gi, run by /usr/bin/python3), and ffmpeg
for what serve itself does by it. What is missing is skipped, and said so. The exit code is 1 if a
case delivers too few boxes or takes them for those of other frames.
"""

import argparse
import json
import math
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time

WIDTH, HEIGHT, RATE = 1280, 720, 30
LOOP, RADIUS, SIDE = 120, 250, 80  # frames per round, pixels
PIXELS = WIDTH * HEIGHT
BYTES = PIXELS * 3 // 2  # I420
LEAST = 0.9  # share of frames that must have a box
RAW = f"rawvideoparse format=i420 width={WIDTH} height={HEIGHT} framerate={RATE}/1"
ENCODE = f"x264enc tune=zerolatency speed-preset=ultrafast key-int-max={RATE} bitrate=8000"
RTP = "application/x-rtp,media=video,encoding-name=H264,clock-rate=90000,payload=96"
DECODE = "rtph264depay ! h264parse ! avdec_h264"
TOLD = "videoconvert ! video/x-raw,format=I420 ! fdsink sync=false fd="


def place(index):
    """Left and top edge of the target; even numbers, as chroma has half the width."""
    angle = 2 * math.pi * index / LOOP
    x = WIDTH / 2 + RADIUS * math.cos(angle) - SIDE / 2
    y = HEIGHT / 2 + RADIUS * math.sin(angle) - SIDE / 2
    return 2 * round(x / 2), 2 * round(y / 2)


def frame_of(x, y):
    """The place in the round of a target with its center at (x, y), as a fraction of a frame."""
    return math.atan2(y - HEIGHT / 2, x - WIDTH / 2) / (2 * math.pi) * LOOP % LOOP


def pictures():
    """The frames of one round as I420: a violet chessboard before blocks of gray."""
    block, state = 16, 7
    ground = bytearray()
    for _ in range(HEIGHT // block):
        row = bytearray()
        for _ in range(WIDTH // block):
            state = state * 1103515245 + 12345 & 0x7FFFFFFF
            row += bytes([70 + (state >> 16) % 70]) * block
        ground += bytes(row) * block
    ground += bytes([128]) * (PIXELS // 2)
    made = []
    for index in range(LOOP):
        picture = bytearray(ground)
        left, top = place(index)
        for j in range(SIDE):
            at = (top + j) * WIDTH + left
            picture[at : at + SIDE] = bytes(
                60 if (i // 20 + j // 20) % 2 else 170 for i in range(SIDE)
            )
        for plane in (PIXELS, PIXELS * 5 // 4):
            for j in range(SIDE // 2):
                at = plane + (top // 2 + j) * (WIDTH // 2) + left // 2
                picture[at : at + SIDE // 2] = bytes([210]) * (SIDE // 2)
        made.append(bytes(picture))
    return made


VIOLET = bytes(int(value > 175) for value in range(256))


def seen(picture):
    """The center of the violet target in a decoded picture, or None."""
    width = WIDTH // 2
    marked = picture[PIXELS : PIXELS * 5 // 4].translate(VIOLET)
    rows, sums = [], []
    for row in range(0, HEIGHT // 2, 2):
        line = marked[row * width : (row + 1) * width]
        left = line.find(1)
        if left >= 0:
            rows.append(row)
            sums.append(left + line.rfind(1) + 1)
    if not rows:
        return None
    return sum(sums) / len(sums), rows[0] + rows[-1] + 2


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Camera:
    """A thread that hands a frame to `write` at its time: the first one until `moves` is set."""

    def __init__(self, frames, write):
        self.frames, self.write = frames, write
        self.moves, self.ends = threading.Event(), threading.Event()
        self.taken = []  # times of the frames since it moves
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        due = time.monotonic()
        while not self.ends.is_set():
            time.sleep(max(0, due - time.monotonic()))
            index = 0
            if self.moves.is_set():
                index = len(self.taken) % LOOP
                self.taken.append(time.monotonic())
            try:
                self.write(self.frames[index])
            except (BrokenPipeError, ValueError):
                return
            due = max(due + 1 / RATE, time.monotonic() - 0.1)

    def age(self, position, now):
        """Seconds since the frame at a position of the round was taken, and its number."""
        whole = round(position) % LOOP
        latest = len(self.taken) - 1
        number = latest - (latest - whole) % LOOP
        return (now - self.taken[number], number) if number >= 0 else None


def launch(pipeline, **options):
    command = ["gst-launch-1.0", "-q", *pipeline.split()]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, **options)


def sender(pipeline):
    """A pipeline that takes frames on its standard input."""
    return launch(f"fdsrc fd=0 blocksize={BYTES} ! {RAW} ! {pipeline}", stdin=subprocess.PIPE)


class RtspServer:
    """A camera at /in, and a place at /out that takes a stream and writes its pictures to `fd`."""

    def __init__(self, fd):
        import gi

        gi.require_version("Gst", "1.0")
        gi.require_version("GstRtspServer", "1.0")
        from gi.repository import GLib, Gst, GstRtspServer

        Gst.init(None)
        self.gst, self.source = Gst, None
        self.server = GstRtspServer.RTSPServer()
        self.server.set_address("127.0.0.1")
        self.server.set_service("0")
        camera = GstRtspServer.RTSPMediaFactory()
        format = f"video/x-raw,format=I420,width={WIDTH},height={HEIGHT},framerate={RATE}/1"
        camera.set_launch(
            f"( appsrc name=source is-live=true do-timestamp=true format=time caps={format} "
            f"! {ENCODE} ! rtph264pay name=pay0 pt=96 )"
        )
        camera.set_shared(True)
        camera.connect("media-configure", self.configure)
        receiver = GstRtspServer.RTSPMediaFactory()
        receiver.set_launch(
            f"( rtph264depay name=depay0 ! h264parse ! avdec_h264 ! {TOLD}{fd} )"
        )
        receiver.set_transport_mode(GstRtspServer.RTSPTransportMode.RECORD)
        receiver.set_latency(0)
        points = self.server.get_mount_points()
        points.add_factory("/in", camera)
        points.add_factory("/out", receiver)
        self.server.attach(None)
        threading.Thread(target=GLib.MainLoop().run, daemon=True).start()
        self.address = f"rtsp://127.0.0.1:{self.server.get_bound_port()}"

    def configure(self, _, media):
        self.source = media.get_element().get_by_name("source")

    def write(self, picture):
        if self.source:
            self.source.emit("push-buffer", self.gst.Buffer.new_wrapped(picture))


class Case:
    """One way in or out: what serve is told, and the processes around it."""

    def __init__(self, name, rtsp):
        self.processes, self.folder = [], tempfile.mkdtemp(prefix="latency-")
        self.film = None  # where decoded pictures come from
        self.write = None  # None: to serve's standard input
        way, _, kind = name.partition(" ")
        port = free_port()
        if way == "out":
            self.options = ["--input", "-", "--raw", f"{WIDTH}x{HEIGHT}", "--pix", "yuv420p"]
            if kind == "rtp":
                source = f"udpsrc address=127.0.0.1 port={port} caps={RTP} ! {DECODE} ! {TOLD}1"
                receiver = self.add(launch(source, stdout=subprocess.PIPE))
                self.film = receiver.stdout
                self.options += ["--video-out", f"rtp://127.0.0.1:{port}"]
            else:
                self.film = rtsp[1]
                self.options += ["--video-out", f"{rtsp[0].address}/out"]
        elif kind == "pipe":
            self.options = ["--input", "-", "--raw", f"{WIDTH}x{HEIGHT}", "--pix", "yuv420p"]
        elif kind == "gst:shmsrc":
            path = os.path.join(self.folder, "frames")
            self.through(f"shmsink socket-path={path} shm-size={16 * BYTES} sync=false"
                         " wait-for-connection=false")
            format = f"video/x-raw,format=I420,width={WIDTH},height={HEIGHT},framerate={RATE}/1"
            self.options = [
                "--input",
                f"gst:shmsrc socket-path={path} is-live=true do-timestamp=true ! {format}",
            ]
        elif kind in ("rtp", "gst:udpsrc"):
            self.through(f"{ENCODE} ! rtph264pay config-interval=1 pt=96"
                         f" ! udpsink host=127.0.0.1 port={port} sync=false")
            source = f"gst:udpsrc port={port} caps={RTP} ! {DECODE}"
            self.options = ["--input", f"rtp:{port}" if kind == "rtp" else source]
        else:
            self.write = rtsp[0].write
            self.options = ["--input", f"{rtsp[0].address}/in"]

    def add(self, process):
        self.processes.append(process)
        return process

    def through(self, pipeline):
        self.write = self.writer(self.add(sender(pipeline)).stdin)

    @staticmethod
    def writer(pipe):
        def write(picture):
            pipe.write(picture)
            pipe.flush()

        return write

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


class Measured:
    """Ages of frames, in seconds, by the number of the frame."""

    def __init__(self):
        self.ages, self.offsets = {}, []

    def add(self, camera, center, now):
        position = frame_of(*center)
        if found := camera.age(position, now):
            age, number = found
            self.ages.setdefault(number, age)
            self.offsets.append((position - number + LOOP / 2) % LOOP - LOOP / 2)

    def until(self, sent):
        """Only the frames below a number."""
        self.ages = {number: age for number, age in self.ages.items() if number < sent}
        return self

    def row(self, name, sent):
        ages = sorted(1e3 * age for age in self.ages.values())
        if not ages:
            return f"{name:22} nothing came"
        at = lambda share: ages[min(len(ages) - 1, int(share * len(ages)))]  # noqa: E731
        off = max(abs(offset) for offset in self.offsets)
        return (
            f"{name:22} {sent:6} {len(ages):6} {at(0.5):8.1f} {at(0.99):8.1f} {ages[-1]:8.1f}"
            f" {off:8.2f}"
        )

    def is_good(self, sent):
        # A place that lies half a frame off may be the next frame's.
        off = [offset for offset in self.offsets if abs(offset) > 0.45]
        return len(self.ages) > max(0, LEAST * sent) and len(off) <= 0.02 * len(self.offsets)


def watch_film(film, camera, measured):
    rest = bytearray()
    while chunk := film.read(BYTES - len(rest)):
        rest += chunk
        if len(rest) == BYTES:
            now = time.monotonic()
            if camera.moves.is_set() and (center := seen(bytes(rest))):
                measured.add(camera, center, now)
            rest.clear()


def measure(program, name, frames, rtsp, seconds, options):
    """The rows of a case, and whether all is well."""
    case = Case(name, rtsp)
    reports = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    reports.bind(("127.0.0.1", 0))
    reports.settimeout(0.2)
    commands = free_port()
    command = [program, "serve", *case.options, "--quiet", *options]
    command += ["--udp", f"127.0.0.1:{reports.getsockname()[1]}", "--commands", f"udp:{commands}"]
    said = tempfile.TemporaryFile()
    serve = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=said)
    camera = Camera(frames, case.write or case.writer(serve.stdin))
    boxes, film = Measured(), Measured()
    if case.film:
        arguments = (case.film, camera, film)
        threading.Thread(target=watch_film, args=arguments, daemon=True).start()
    left, top = place(0)
    start = json.dumps({"command": "start", "box": [left, top, SIDE, SIDE]}).encode()
    tracked, asked, deadline = 0, 0.0, time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            report = json.loads(reports.recv(65536))
            now = time.monotonic()
        except TimeoutError:
            if serve.poll() is not None:
                break
            continue
        if camera.moves.is_set():
            box = report.get("box")
            if box:
                boxes.add(camera, (box[0] + box[2] / 2, box[1] + box[3] / 2), now)
        elif report.get("box"):
            tracked += 1
            if tracked == 2 * RATE:
                camera.moves.set()
                deadline = time.monotonic() + seconds
        elif report.get("frame", 0) > 2 * RATE and now - asked > 2:
            asked = now
            reports.sendto(start, ("127.0.0.1", commands))
    sent = max(0, len(camera.taken) - RATE // 2)  # the last ones are still on their way
    camera.ends.set()
    serve.terminate()
    try:
        serve.wait(20)
    except subprocess.TimeoutExpired:
        serve.kill()
    case.end()
    rows, is_good = [boxes.until(sent).row(f"{name}, box", sent)], boxes.is_good(sent)
    if case.film:
        rows.append(film.until(sent).row(f"{name}, video", sent))
        is_good &= film.is_good(sent)
    if not is_good:
        said.seek(0)
        rows.append("FAILED " + said.read()[-600:].decode(errors="replace").strip())
    return rows, is_good


CASES = ["in pipe", "in gst:shmsrc", "in gst:udpsrc", "in rtp", "in rtsp", "out rtp", "out rtsp"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--only", metavar="NAME", help=f"one of {', '.join(CASES)}")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("options", nargs="*", help="of serve, behind --")
    args = parser.parse_args()

    rtsp = None
    pictures_out, fd = os.pipe()
    try:
        rtsp = RtspServer(fd), os.fdopen(pictures_out, "rb", buffering=0)
    except (ImportError, ValueError) as error:
        print(f"skipped: RTSP: no gst-rtsp-server for this Python ({error})")
    frames, all_good = pictures(), True
    print(f"{WIDTH}x{HEIGHT}, {RATE} frames per second, ms from the camera")
    print(f"{'':22} {'frames':>6} {'came':>6} {'median':>8} {'99 %':>8} {'maximum':>8} {'off':>8}")
    for name in CASES:
        needed = [] if name == "in pipe" else ["gst-launch-1.0"]
        if name in ("in rtp", "in rtsp", "out rtp", "out rtsp"):
            needed.append("ffmpeg")
        missing = [tool for tool in needed if not shutil.which(tool)]
        if (args.only and args.only != name) or (name.endswith("rtsp") and not rtsp):
            continue
        if missing:
            print(f"skipped: {name}: no {missing[0]}")
            continue
        rows, is_good = measure(args.program, name, frames, rtsp, args.seconds, args.options)
        all_good &= is_good
        print("\n".join(rows), flush=True)
    sys.exit(0 if all_good else 1)


if __name__ == "__main__":
    main()
