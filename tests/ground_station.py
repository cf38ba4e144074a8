#!/usr/bin/env python3
"""A ground station made of pymavlink, against `track-cpu serve` as a MAVLink camera.

    python3 -m venv v && v/bin/pip install pymavlink
    v/bin/python tests/ground_station.py target/release/track-cpu
    v/bin/python tests/ground_station.py target/release/track-cpu --soak 3600

It sends pictures through standard input: a checkered target over a patchwork, which vanishes and
comes back. Every check prints a line; the exit code is 1 if any fails. `cargo test` has the same
dialogue in Rust. `--soak SECONDS` repeats it over a link that loses every hundredth packet, and
looks for stalls and leaks.
"""
import argparse
import os
import random
import socket
import subprocess
import sys
import threading
import time

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"
from pymavlink import mavutil  # noqa: E402

M = mavutil.mavlink
WIDTH, HEIGHT, RATE = 320, 180, 12
TARGET = (142, 76, 36, 28)
failures = []


def check(what, passed):
    print(("ok      " if passed else "FAILED  ") + what, flush=True)
    if not passed:
        failures.append(what)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def patchwork():
    """Rows of a picture of random 10 x 10 patches, and the same with the target on it."""
    chance = random.Random(7)
    empty = []
    for _ in range(HEIGHT // 10):
        row = b"".join(bytes(chance.randrange(60, 150) for _ in range(3)) * 10 for _ in range(WIDTH // 10))
        empty += [row] * 10
    shown = [bytearray(row) for row in empty]
    x, y, w, h = TARGET
    for j in range(h):
        line = b"".join((b"\x20\x20\xf0" if (i // 9 + j // 7) % 2 else b"\xf0\xe0\x10") for i in range(w))
        shown[y + j][3 * x : 3 * (x + w)] = line
    return b"".join(empty), b"".join(bytes(row) for row in shown)


class Camera:
    """A running program and the pictures it is fed with."""

    def __init__(self, program, *options, port=None):
        self.port = port or free_port()
        self.empty, self.shown = patchwork()
        self.visible, self.ended, self.hangs = True, False, False
        command = [program, "serve", "--input", "-", "--raw", f"{WIDTH}x{HEIGHT}", "--pix", "bgr24", "--quiet"]
        command += ["--max-age-ms", "2000", "--stall-ms", "8000", "--mavlink", f"udpout:127.0.0.1:{self.port}", *options]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        threading.Thread(target=self.feed, daemon=True).start()

    def feed(self):
        while not self.ended:
            try:
                if not self.hangs:
                    self.process.stdin.write(self.shown if self.visible else self.empty)
                    self.process.stdin.flush()
            except OSError:
                return
            time.sleep(1 / RATE)

    def resident(self):
        """Resident memory in MB."""
        with open(f"/proc/{self.process.pid}/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024

    def handles(self):
        """Threads and open files."""
        folder = f"/proc/{self.process.pid}"
        return len(os.listdir(f"{folder}/task")) + len(os.listdir(f"{folder}/fd"))

    def end(self):
        self.process.terminate()
        code = self.process.wait(timeout=20)
        self.ended = True
        return code


class LossyLink:
    """Carries datagrams between two ports and loses a share of them, both ways."""

    def __init__(self, station, share):
        self.port, self.station, self.share = free_port(), ("127.0.0.1", station), share
        self.carried = self.lost = 0
        self.inner, self.outer = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.inner.bind(("127.0.0.1", self.port))
        self.outer.bind(("127.0.0.1", 0))
        self.camera = None
        for way in (self.to_station, self.to_camera):
            threading.Thread(target=way, daemon=True).start()

    def lose(self, chance):
        lost = chance.random() < self.share
        self.lost, self.carried = self.lost + lost, self.carried + (not lost)
        return lost

    def to_station(self):
        chance = random.Random(1)
        while True:
            data, self.camera = self.inner.recvfrom(2048)
            if not self.lose(chance):
                self.outer.sendto(data, self.station)

    def to_camera(self):
        chance = random.Random(2)
        while True:
            data, _ = self.outer.recvfrom(2048)
            if self.camera and not self.lose(chance):
                self.inner.sendto(data, self.camera)


class Station:
    def __init__(self, camera, system=255, port=None):
        address = f"udpin:127.0.0.1:{port or camera.port}"
        self.link = mavutil.mavlink_connection(address, source_system=system, source_component=190)

    def command(self, command, *parameters):
        self.link.mav.command_long_send(1, 100, command, 0, *(list(parameters) + [0] * (7 - len(parameters))))

    def wait(self, kind, seconds=20, accept=lambda message: True):
        until = time.time() + seconds
        while time.time() < until:
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.5)
            if message is not None and accept(message):
                return message
        return None

    def result(self, command, seconds=20):
        final = lambda ack: ack.command == command and ack.result != M.MAV_RESULT_IN_PROGRESS
        ack = self.wait("COMMAND_ACK", seconds, final)
        return None if ack is None else ack.result

    def status(self, accept=lambda status: True, seconds=30):
        return self.wait("CAMERA_TRACKING_IMAGE_STATUS", seconds, accept)


def dialogue(program):
    camera = Camera(program, "--video-uri", "rtsp://127.0.0.1:8554/main")
    station = Station(camera)
    heartbeat = station.wait("HEARTBEAT")
    check("heartbeat of a camera", heartbeat is not None and heartbeat.type == M.MAV_TYPE_CAMERA)
    for name, command in (("new", (M.MAV_CMD_REQUEST_MESSAGE, 259)), ("old", (M.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1))):
        station.command(*command)
        information = station.wait("CAMERA_INFORMATION")
        good = information is not None and information.flags & 1793 == 1792 and information.resolution_h == WIDTH
        check(f"camera information in the {name} form, with the size", good)
    station.command(M.MAV_CMD_REQUEST_MESSAGE, 269)
    stream = station.wait("VIDEO_STREAM_INFORMATION")
    check("video stream", stream is not None and stream.uri.startswith("rtsp://127.0.0.1"))
    check("idle at first", station.status().tracking_status == 0)

    x, y, w, h = TARGET
    rectangle = (x / WIDTH, y / HEIGHT, (x + w) / WIDTH, (y + h) / HEIGHT)
    station.command(M.MAV_CMD_CAMERA_TRACK_RECTANGLE, *rectangle)
    check("rectangle accepted", station.result(M.MAV_CMD_CAMERA_TRACK_RECTANGLE) == M.MAV_RESULT_ACCEPTED)
    status = station.status(lambda s: s.tracking_status == 1)
    check("active", status is not None)
    check("box on the target", status is not None and abs(status.rec_top_x - rectangle[0]) < 0.05)
    station.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, 275, 500000)
    check("interval accepted", station.result(M.MAV_CMD_SET_MESSAGE_INTERVAL) == M.MAV_RESULT_ACCEPTED)
    until, count = time.time() + 4, 0
    while time.time() < until:
        count += station.link.recv_match(type="CAMERA_TRACKING_IMAGE_STATUS", blocking=True, timeout=0.5) is not None
    check(f"2 Hz as asked for ({count} in 4 s)", 6 <= count <= 12)
    station.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, 275, 50000)
    time.sleep(2)
    camera.visible = False
    check("coasting while the target is hidden", station.status(lambda s: s.tracking_status == 9) is not None)
    check("an error once it is lost", station.status(lambda s: s.tracking_status == 2) is not None)
    camera.visible = True
    check("active again", station.status(lambda s: s.tracking_status == 1) is not None)

    for command in (M.MAV_CMD_DO_SET_HOME, M.MAV_CMD_SET_CAMERA_ZOOM, 64999):
        station.command(command)
        check(f"command {command} acknowledged as unsupported", station.result(command) == M.MAV_RESULT_UNSUPPORTED)
    station.link.mav.srcSystem = 77
    station.command(M.MAV_CMD_CAMERA_STOP_TRACKING)
    check("a strange system is denied control", station.result(M.MAV_CMD_CAMERA_STOP_TRACKING) == M.MAV_RESULT_DENIED)
    station.link.mav.srcSystem = 255
    for _ in range(50):
        station.link.write(os.urandom(60))
    station.command(M.MAV_CMD_CAMERA_STOP_TRACKING)
    check("stop accepted, after noise", station.result(M.MAV_CMD_CAMERA_STOP_TRACKING) == M.MAV_RESULT_ACCEPTED)
    check("idle again", station.status(lambda s: s.tracking_status == 0) is not None)
    station.command(M.MAV_CMD_CAMERA_TRACK_POINT, (x + w / 2) / WIDTH, (y + h / 2) / HEIGHT, float("nan"))
    check("point accepted", station.result(M.MAV_CMD_CAMERA_TRACK_POINT) == M.MAV_RESULT_ACCEPTED)
    status = station.status(lambda s: s.tracking_status & 1 == 1)
    check("active by point", status is not None and status.tracking_mode == M.CAMERA_TRACKING_MODE_POINT)
    check("ends on SIGTERM", camera.end() == 0)


def signing(program, folder):
    key, path = bytes(range(32)), os.path.join(folder, "key")
    with open(path, "wb") as file:
        file.write(key)
    camera = Camera(program, "--mav-key", path)
    station = Station(camera)
    check("signed camera is heard", station.wait("HEARTBEAT") is not None)
    station.command(M.MAV_CMD_REQUEST_MESSAGE, 259)
    check("unsigned command is refused", station.wait("CAMERA_INFORMATION", 2) is None)
    station.link.setup_signing(bytes(reversed(key)), sign_outgoing=True, allow_unsigned_callback=lambda *_: True)
    station.command(M.MAV_CMD_REQUEST_MESSAGE, 259)
    time.sleep(1)
    station.link.disable_signing()
    check("wrong key is refused", station.wait("CAMERA_INFORMATION", 2) is None)
    station.link.setup_signing(key, sign_outgoing=True)
    station.command(M.MAV_CMD_REQUEST_MESSAGE, 259)
    check("signed command is answered", station.wait("CAMERA_INFORMATION", 10) is not None)
    check("signed camera ends", camera.end() == 0)


class Ear:
    """Listens all the time: the last status, and the longest silence of each kind of message."""

    def __init__(self, station):
        self.station, self.status, self.acks = station, None, []
        self.heard, self.silence, self.ended = {}, {}, False
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while not self.ended:
            message = self.station.link.recv_match(blocking=True, timeout=0.5)
            if message is None:
                continue
            kind, now = message.get_type(), time.time()
            before = self.heard.get(kind, now)
            self.heard[kind], self.silence[kind] = now, max(self.silence.get(kind, 0), now - before)
            if kind == "COMMAND_ACK" and message.result != M.MAV_RESULT_IN_PROGRESS:
                self.acks.append((message.command, message.result))
            if kind == "CAMERA_TRACKING_IMAGE_STATUS":
                self.status = message.tracking_status

    def until(self, holds, seconds):
        end = time.time() + seconds
        while time.time() < end:
            if holds():
                return True
            time.sleep(0.05)
        return False


def soak(program, seconds, options):
    """Rounds of start, hide, show, noise, a camera that hangs, stop, over a link that loses 1 %."""
    station_port = free_port()
    link = LossyLink(station_port, 0.01)
    camera = Camera(program, *options, port=link.port)
    station = Station(camera, port=station_port)
    ear = Ear(station)
    check("heartbeat over the lossy link", ear.until(lambda: "HEARTBEAT" in ear.heard, 30))
    x, y, w, h = TARGET
    rectangle = (x / WIDTH, y / HEIGHT, (x + w) / WIDTH, (y + h) / HEIGHT)
    end, rounds, again, faults, memory, handles = time.time() + seconds, 0, 0, [], [], []

    def insist(command, *parameters):
        """As ground stations do: again until acknowledged."""
        for attempt in range(5):
            ear.acks.clear()
            station.command(command, *parameters)
            if ear.until(lambda: any(ack[0] == command for ack in ear.acks), 3):
                return attempt
        faults.append(f"round {rounds}: command {command} never acknowledged")
        return 5

    def expect(what, holds, seconds=40):
        if not ear.until(holds, seconds):
            faults.append(f"round {rounds}: {what}, status {ear.status}")

    while time.time() < end and len(faults) < 20:
        rounds += 1
        camera.visible = True
        again += insist(M.MAV_CMD_REQUEST_MESSAGE, 259)
        again += insist(M.MAV_CMD_CAMERA_TRACK_RECTANGLE, *rectangle)
        again += insist(M.MAV_CMD_SET_MESSAGE_INTERVAL, 275, random.choice((50000, 100000, 500000)))
        expect("never active", lambda: ear.status == 1)
        time.sleep(6)
        camera.visible = False
        expect("never coasting", lambda: ear.status in (9, 2))
        time.sleep(random.uniform(0, 8))
        camera.visible = True
        expect("never active again", lambda: ear.status == 1)
        for _ in range(20):
            station.link.write(os.urandom(random.randrange(1, 300)))
        time.sleep(3)
        camera.hangs = True  # the pipe stays open
        expect("no error while frames have stopped", lambda: ear.status == 2)
        camera.hangs = False
        expect("never active after frames had stopped", lambda: ear.status == 1)
        again += insist(M.MAV_CMD_CAMERA_STOP_TRACKING)
        expect("never idle", lambda: ear.status == 0)
        memory.append(camera.resident())
        handles.append(camera.handles())
        if rounds % 10 == 1:
            left = max(0, end - time.time())
            print(f"        round {rounds}, {memory[-1]:.1f} MB, {left:.0f} s left", file=sys.stderr, flush=True)
    ear.ended = True
    for fault in faults:
        print("        " + fault)
    print(f"        {rounds} rounds, {link.lost} of {link.lost + link.carried} packets lost, {again} commands repeated")
    check("every round ran as it should", not faults)
    beat, status = (ear.silence.get(kind, 0) for kind in ("HEARTBEAT", "CAMERA_TRACKING_IMAGE_STATUS"))
    check(f"no stall: longest silence {beat:.1f} s of heartbeats, {status:.1f} s of status", beat < 5 and status < 5)
    warm = memory[len(memory) // 5 :]
    check(f"no leak: {warm[0]:.1f} MB, in the end {warm[-1]:.1f}", warm[-1] < 1.02 * warm[0] + 1)
    check(f"threads and files stay: {handles[0]}, in the end {handles[-1]}", handles[-1] <= handles[0] + 2)
    check("ends on SIGTERM", camera.end() == 0)


def main():
    import tempfile

    parser = argparse.ArgumentParser(description="A ground station against `track-cpu serve`.")
    parser.add_argument("program", nargs="?", default="target/release/track-cpu")
    parser.add_argument("--soak", type=float, metavar="SECONDS", help="only the soak, for so long")
    parser.add_argument("--model", help="built-in model or weights file for the soak")
    args = parser.parse_args()
    if args.soak:
        soak(args.program, args.soak, ["--model", args.model] if args.model else [])
    else:
        dialogue(args.program)
        with tempfile.TemporaryDirectory() as folder:
            signing(args.program, folder)
    print(f"{len(failures)} failed" if failures else "all passed")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
