#!/usr/bin/env python3
"""Faults in front of `track-cpu serve`: when each is noticed, what is said, if the gimbal rests.

    python3 -m venv v && v/bin/pip install pymavlink
    v/bin/python tests/faults.py target/release/track-cpu
    v/bin/python tests/faults.py target/release/track-cpu --soak 3600

The camera is an HTTP stream of 30 JPEGs a second, made here and read through ffmpeg; its target
moves. A ground station listens over MAVLink. Without --soak every fault is tried once, and the
table is printed as Markdown. A soak tries one fault a minute, prints the ages of reports, memory,
threads and open files, and fails if these grow with the number of faults. The exit code is 1 if
anything is not as it should be.
"""

import argparse
import collections
import http.client
import json
import math
import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"
try:
    from pymavlink import mavutil
except ImportError:
    print("skipped: pymavlink is not installed")
    sys.exit(0)
if not shutil.which("ffmpeg"):
    print("skipped: ffmpeg is not installed")
    sys.exit(0)

M = mavutil.mavlink
WIDTH, HEIGHT, RATE, LOOP = 640, 360, 30, 120
SIDE = 44
STALL, MAX_AGE = 2.0, 0.25
TOKEN = "fault-token"
failures = []


def check(what, passed):
    print(("ok      " if passed else "FAILED  ") + what, flush=True)
    if not passed:
        failures.append(what)


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def place(index):
    """Left and top edge of the target, which goes round once in LOOP frames, off the middle."""
    angle = 2 * math.pi * index / LOOP
    return int(430 + 40 * math.cos(angle)), int(220 + 25 * math.sin(angle))


def frames(width=WIDTH, height=HEIGHT):
    """The JPEGs of one round."""
    chance = random.Random(7)
    ground = bytearray()
    for _ in range(HEIGHT // 10):
        row = b"".join(
            bytes(chance.randrange(70, 140) for _ in range(3)) * 10 for _ in range(WIDTH // 10)
        )
        ground += row * 10
    raw = bytearray()
    for index in range(LOOP):
        picture = bytearray(ground)
        x, y = place(index)
        for j in range(SIDE):
            line = b"".join(
                (b"\xf0\x20\x20" if (i // 9 + j // 7) % 2 else b"\x10\xe0\xf0") for i in range(SIDE)
            )
            at = 3 * ((y + j) * WIDTH + x)
            picture[at : at + len(line)] = line
        raw += picture
    command = [
        "ffmpeg",
        "-v",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{WIDTH}x{HEIGHT}",
        "-i",
        "-",
    ]
    command += [
        "-vf",
        f"scale={width}:{height}",
        "-q:v",
        "4",
        "-f",
        "image2pipe",
        "-c:v",
        "mjpeg",
        "-",
    ]
    stream = subprocess.run(command, input=bytes(raw), stdout=subprocess.PIPE, check=True).stdout
    return [b"\xff\xd8\xff" + part for part in stream.split(b"\xff\xd8\xff")[1:]]


class Camera:
    """An HTTP server of one endless multipart stream."""

    def __init__(self):
        self.normal, self.small = frames(), frames(320, 180)
        self.mode, self.index = "live", 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.connections = []
        threading.Thread(target=self.accept, daemon=True).start()
        threading.Thread(target=self.play, daemon=True).start()

    def accept(self):
        while True:
            connection, _ = self.listener.accept()
            if self.mode in ("closed", "dead"):
                connection.close()
                continue
            head = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=f\r\n\r\n"
            connection.settimeout(2)
            try:
                connection.recv(4096)
                connection.sendall(head)
                self.connections.append(connection)
            except OSError:
                connection.close()

    def play(self):
        due = time.monotonic()
        while True:
            due = max(due + (1 / 3 if self.mode == "slow" else 1 / RATE), time.monotonic() - 0.2)
            time.sleep(max(0, due - time.monotonic()))
            if self.mode != "repeated":
                self.index += 1
            if self.mode == "closed":
                while self.connections:
                    self.connections.pop().close()
            if self.mode in ("frozen", "closed"):
                continue
            picture = (self.small if self.mode == "small" else self.normal)[self.index % LOOP]
            part = b"--f\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (
                len(picture),
                picture,
            )
            if self.mode == "garbage":
                part = os.urandom(len(part))
            if self.mode == "damaged":
                spoilt = bytearray(picture)
                for _ in range(40):
                    spoilt[random.randrange(700, len(spoilt))] = random.randrange(256)
                part = part.replace(picture, bytes(spoilt))
            for connection in list(self.connections):
                try:
                    connection.sendall(part)
                except OSError:
                    self.connections.remove(connection)
                    connection.close()


class Rig:
    """A running program with everything around it, and what was heard from it."""

    def __init__(self, program, camera, *options):
        self.camera, self.folder = camera, tempfile.mkdtemp(prefix="faults-")
        self.is_mounted = (
            subprocess.run(
                ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", self.folder],
                stderr=subprocess.DEVNULL,
            ).returncode
            == 0
        )
        self.gcs, self.page, self.second = (
            free_port(),
            free_port(socket.SOCK_STREAM),
            free_port(socket.SOCK_STREAM),
        )
        self.command = [program, "serve", "--input", f"http://127.0.0.1:{camera.port}/"]
        self.command += [
            "--max-age-ms",
            str(int(MAX_AGE * 1000)),
            "--stall-ms",
            str(int(STALL * 1000)),
        ]
        self.command += ["--mavlink", f"udpout:127.0.0.1:{self.gcs}", "--gimbal", "--hfov", "62"]
        self.command += ["--mavlink", f"tcpout:127.0.0.1:{self.second}"]
        self.command += ["--http", f"127.0.0.1:{self.page}", "--token", TOKEN]
        self.command += [
            "--log",
            os.path.join(self.folder, "f.jsonl"),
            "--log-size",
            "1",
            "--log-total",
            "8",
            *options,
        ]
        self.heard = collections.deque(maxlen=200_000)  # (time, kind, value)
        self.said, self.ages, self.withheld = collections.deque(maxlen=2000), [], 0
        self.lock, self.tracked = threading.Lock(), 0
        self.router = Router(self.second)
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{self.gcs}", source_system=255, source_component=190
        )
        self.start()
        threading.Thread(target=self.listen, daemon=True).start()

    def start(self):
        self.process = subprocess.Popen(
            self.command, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        threading.Thread(target=self.read_lines, args=(self.process.stdout,), daemon=True).start()
        threading.Thread(target=self.read_words, args=(self.process.stderr,), daemon=True).start()

    def note(self, kind, value):
        self.heard.append((time.monotonic(), kind, value))

    def read_lines(self, stream):
        for text in stream:
            try:
                line = json.loads(text)
            except ValueError:
                failures.append(f"a line that is no JSON: {text[:80]}")
                continue
            if line.get("box") is not None:
                self.ages.append(line["age_ms"])
                self.tracked += 1
            self.note("line", line)

    def read_words(self, stream):
        for line in stream:
            self.said.append(line.decode(errors="replace").rstrip())
            self.note("said", self.said[-1])

    def listen(self):
        while True:
            try:
                message = self.link.recv_match(blocking=True, timeout=1)
            except (OSError, ValueError):
                continue
            if message is None:
                continue
            kind = message.get_type()
            if kind == "CAMERA_TRACKING_IMAGE_STATUS":
                self.note("status", message.tracking_status)
            elif kind == "GIMBAL_MANAGER_SET_PITCHYAW":
                self.note("rates", (message.pitch_rate, message.yaw_rate))
            elif kind == "HEARTBEAT":
                self.note("beat", message.system_status)
            elif (
                kind == "COMMAND_LONG" and message.command == M.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
            ):
                self.note("control", message.param1)
            elif kind == "COMMAND_ACK":
                self.note("ack", (message.command, message.result))

    def since(self, start, kind, holds):
        """Seconds from `start` until the first event of a kind that holds; `None` without any."""
        for at, what, value in list(self.heard):
            if at >= start and what == kind and holds(value):
                return at - start
        return None

    def wait(self, start, kind, holds, seconds=30):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = self.since(start, kind, holds)
            if found is not None:
                return found
            time.sleep(0.02)
        return None

    def last(self, start, kind, holds):
        """Seconds from `start` until the last event of a kind that holds."""
        times = [
            at - start
            for at, what, value in list(self.heard)
            if at >= start and what == kind and holds(value)
        ]
        return times[-1] if times else None

    def command_long(self, command, *parameters):
        self.link.mav.command_long_send(
            1, 100, command, 0, *(list(parameters) + [0] * (7 - len(parameters)))
        )

    def track(self):
        """Follows the target where it was a moment ago."""
        for _ in range(20):
            x, y = place(self.camera.index % LOOP)
            began = time.monotonic()
            rectangle = (x / WIDTH, y / HEIGHT, (x + SIDE) / WIDTH, (y + SIDE) / HEIGHT)
            self.command_long(M.MAV_CMD_CAMERA_TRACK_RECTANGLE, *rectangle)
            accepted = (M.MAV_CMD_CAMERA_TRACK_RECTANGLE, M.MAV_RESULT_ACCEPTED)
            if self.wait(began, "ack", lambda ack: ack == accepted, 2) is not None:
                return True
        return False

    def state(self):
        try:
            connection = http.client.HTTPConnection("127.0.0.1", self.page, timeout=3)
            connection.request("GET", "/state")
            return json.load(connection.getresponse())
        except (OSError, ValueError, http.client.HTTPException):
            return {}

    def post(self, path, body=b""):
        try:
            connection = http.client.HTTPConnection("127.0.0.1", self.page, timeout=5)
            connection.request("POST", path, body, {"X-Token": TOKEN})
            return connection.getresponse().status
        except (OSError, http.client.HTTPException):
            return 0

    def ffmpeg(self):
        children = subprocess.run(
            ["pgrep", "-P", str(self.process.pid)], stdout=subprocess.PIPE
        ).stdout.split()
        return [int(pid) for pid in children]

    def figures(self):
        """Resident megabytes, threads, open files."""
        folder = f"/proc/{self.process.pid}"
        with open(f"{folder}/status") as status:
            kilobytes = next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))
        return kilobytes / 1024, len(os.listdir(f"{folder}/task")), len(os.listdir(f"{folder}/fd"))

    def fill_disk(self):
        with open(os.path.join(self.folder, "filler"), "wb", buffering=0) as file:
            try:
                while True:
                    file.write(bytes(1 << 16))
            except OSError:
                pass

    def clear_disk(self):
        os.remove(os.path.join(self.folder, "filler"))

    def end(self):
        self.process.terminate()
        code = self.process.wait(timeout=20)
        self.clean()
        return code

    def clean(self):
        if self.is_mounted:
            subprocess.run(["umount", "-l", self.folder])
        shutil.rmtree(self.folder, ignore_errors=True)


class Router:
    """The peer of the second link: it reads, sleeps or is gone."""

    def __init__(self, port):
        self.port, self.mode, self.opened = port, "reads", 0
        self.listener = None
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            if self.mode == "gone":
                time.sleep(0.1)
                continue
            try:
                with socket.create_server(("127.0.0.1", self.port)) as listener:
                    listener.settimeout(0.5)
                    self.serve(listener)
            except OSError:
                time.sleep(0.1)

    def serve(self, listener):
        while self.mode != "gone":
            try:
                connection, _ = listener.accept()
            except OSError:
                continue
            self.opened += 1
            connection.settimeout(0.5)
            with connection:
                while self.mode != "gone":
                    if self.mode == "sleeps":
                        time.sleep(0.1)
                        continue
                    try:
                        if not connection.recv(4096):
                            break
                    except socket.timeout:
                        pass
                    except OSError:
                        break


def crowd(rig, seconds, viewers=64, slow=60):
    """Viewers that never read, and connections whose request drips in; both for a while."""
    held = []
    for index in range(viewers + slow):
        try:
            connection = socket.create_connection(("127.0.0.1", rig.page), 2)
        except OSError:
            continue
        path = ["/video", "/events"][index % 2] if index < viewers else "/"
        text = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        try:
            connection.sendall(text.encode() + (b"\r\n" if index < viewers else b"X-A: "))
        except OSError:
            pass
        held.append(connection)
    end = time.monotonic() + seconds
    stops = []
    while time.monotonic() < end:
        for connection in held[viewers:]:
            try:
                connection.sendall(b"a")
            except OSError:
                pass
        stops.append(rig.state() != {})
        time.sleep(0.5)
    for connection in held:
        connection.close()
    return stops


def noise(rig):
    """Datagrams that are no messages, and messages with flipped bits."""
    heartbeat = rig.link.mav.heartbeat_encode(6, 8, 0, 0, 4).pack(rig.link.mav)
    for _ in range(2000):
        data = bytearray(os.urandom(random.randrange(1, 280)))
        if random.random() < 0.5:
            data = bytearray(heartbeat)
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        rig.link.write(bytes(data))


def seconds(value):
    return "-" if value is None else f"{value:.2f} s"


def moving(rates):
    return abs(rates[0]) + abs(rates[1]) > 0


class Silence:
    """A fault after which no frames come: what everybody is told, and how it ends."""

    def __init__(self, name, begin, end, lasts=6.0):
        self.name, self.begin, self.end, self.lasts = name, begin, end, lasts

    def measure(self, rig):
        start = time.monotonic()
        self.begin(rig)
        time.sleep(self.lasts)
        state = rig.state()
        stale = rig.since(start, "line", lambda line: line["state"] == "stale")
        noticed = rig.since(start, "line", lambda line: line["source"] != "live")
        said = rig.since(start, "said", lambda text: text.startswith("source:"))
        coasting = rig.since(start, "status", lambda status: status & 8)
        error = rig.since(start, "status", lambda status: status == 2)
        beat = rig.since(start, "beat", lambda beat: beat != 4)
        last_move = rig.last(start, "rates", moving)
        rest = rig.since(start, "rates", lambda rates: not moving(rates))
        released = rig.since(start, "control", lambda who: who == -3)
        last_rates = rig.last(start, "rates", lambda _: True)
        again = time.monotonic()
        self.end(rig)
        live = rig.wait(again, "line", lambda line: line["source"] == "live")
        tracking = rig.wait(again, "line", lambda line: line["state"] == "tracking")
        active = rig.wait(again, "status", lambda status: status == 1)
        turns = rig.wait(again, "rates", moving)
        print(
            f"| {self.name} | {seconds(stale)}; {seconds(noticed)} "
            f"| `{state.get('source')}`, `{state.get('state')}`, age {state.get('age_ms', 0) / 1000:.1f} s; stderr {seconds(said)} "
            f"| {seconds(coasting)} COASTING, {seconds(error)} ERROR, heartbeat {seconds(beat)} "
            f"| turns until {seconds(last_move)}, zero {seconds(rest)}, given back {seconds(released)}, silent after {seconds(last_rates)} "
            f"| live {seconds(live)}, tracking {seconds(tracking)}, ACTIVE {seconds(active)}, gimbal {seconds(turns)} |",
            flush=True,
        )
        told = [stale, coasting, error, beat, rest, live, tracking, active, turns]
        is_told = (
            all(time_ is not None for time_ in told)
            and state.get("state") == "stale"
            and not state.get("box")
        )
        check(f"{self.name}: said by every output", is_told)
        check(f"{self.name}: the gimbal rests within the stall time-out", (last_move or 0) < STALL)


class Nuisance:
    """A fault that must not be felt: the longest time between two boxes."""

    def __init__(self, name, during):
        self.name, self.during = name, during

    def measure(self, rig):
        start = time.monotonic()
        told = self.during(rig)
        end = time.monotonic()
        times = [
            at
            for at, what, value in list(rig.heard)
            if start <= at <= end and what == "line" and value.get("box")
        ]
        gap = max((b - a for a, b in zip(times, times[1:])), default=math.inf)
        said = rig.since(start, "said", lambda _: True)
        words = [
            value for at, what, value in list(rig.heard) if start <= at <= end and what == "said"
        ]
        print(
            f"| {self.name} | {seconds(said)} | {told or ''}; stderr: {'; '.join(words[:2]) or '-'} | ACTIVE "
            f"| goes on | longest time between two boxes {gap:.2f} s |",
            flush=True,
        )
        check(
            f"{self.name}: tracking goes on ({len(times)} boxes)", gap < STALL and len(times) > 10
        )


def set_mode(mode):
    def set_it(rig):
        rig.camera.mode = mode

    return set_it


def kill_ffmpeg(rig):
    """Kills the decoder, and lets no other connect."""
    rig.camera.mode = "closed"
    for pid in rig.ffmpeg():
        os.kill(pid, signal.SIGKILL)


def disk(rig):
    if not rig.is_mounted:
        return "skipped: no right to mount a small disk"
    rig.fill_disk()
    time.sleep(6)
    rig.clear_disk()
    time.sleep(34)
    logs = [name for name in os.listdir(rig.folder) if name.startswith("f")]
    return f"{len(logs)} logs"


def link_down(rig):
    before = rig.router.opened
    rig.router.mode = "gone"
    time.sleep(5)
    rig.router.mode = "reads"
    time.sleep(5)
    return f"second link opened {rig.router.opened - before} times again"


def link_sleeps(rig):
    rig.router.mode = "sleeps"
    time.sleep(12)
    rig.router.mode = "reads"
    time.sleep(3)
    return "second link not read for 12 s"


def crowded(rig):
    answered = crowd(rig, 8)
    return f"{sum(answered)} of {len(answered)} other requests answered"


def noisy(rig):
    for _ in range(10):
        noise(rig)
        time.sleep(0.4)
    return "20,000 datagrams"


def for_a_while(mode):
    def run(rig):
        rig.camera.mode = mode
        time.sleep(5)
        rig.camera.mode = "live"
        time.sleep(3)

    return run


def repeated(rig):
    rig.camera.mode = "repeated"
    time.sleep(5)
    source = rig.state().get("source")
    check("one picture for ever: called frozen", source == "frozen")
    rig.camera.mode = "live"
    time.sleep(3)
    return f"source `{source}`"


SILENCES = [
    Silence("stream falls silent, connection stays", set_mode("frozen"), set_mode("live")),
    Silence("stream ends and is refused", set_mode("closed"), set_mode("live")),
    Silence("ffmpeg is killed, stream is refused", kill_ffmpeg, set_mode("live")),
    Silence("stream turns into noise", set_mode("garbage"), set_mode("live")),
]
NUISANCES = [
    Nuisance("log's disk is full", disk),
    Nuisance("second MAVLink peer is gone", link_down),
    Nuisance("second MAVLink peer sleeps", link_sleeps),
    Nuisance("64 viewers never read, 60 requests drip", crowded),
    Nuisance("noise on the MAVLink port", noisy),
    Nuisance("damaged pictures", for_a_while("damaged")),
    Nuisance("pictures of another size", for_a_while("small")),
    Nuisance("one picture for ever", repeated),
]


def restart(rig):
    """SIGKILL, and the program is started again as systemd does."""
    start = time.monotonic()
    children = rig.ffmpeg()
    rig.process.kill()
    rig.process.wait()
    time.sleep(1)
    left = [pid for pid in children if os.path.exists(f"/proc/{pid}/exe")]
    last_move = rig.last(start, "rates", moving)
    start = time.monotonic()
    rig.start()
    live = rig.wait(start, "line", lambda line: line["source"] == "live")
    heard = rig.wait(start, "beat", lambda beat: beat == 4)
    followed = rig.track()
    print(
        f"| SIGKILL, started again | at once | page: no connection; new log `-1` | heartbeat {seconds(heard)} "
        f"| silent after {seconds(last_move)}; the autopilot's own time-out | live {seconds(live)} |",
        flush=True,
    )
    check("a killed program leaves no ffmpeg", not left)
    check("a killed program starts again and follows", live is not None and followed)


def begin(program, *options):
    camera = Camera()
    rig = Rig(program, camera, *options)
    live = rig.wait(0, "beat", lambda beat: beat == 4)
    check(f"frames come ({seconds(live)})", live is not None)
    check("the target is followed", rig.track())
    check("the gimbal turns", rig.wait(0, "rates", moving) is not None)
    return rig


def table(program, options):
    rig = begin(program, *options)
    time.sleep(2)
    print(
        "| fault | noticed | JSON, page, log | MAVLink | gimbal | recovery |\n|---|---|---|---|---|---|",
        flush=True,
    )
    for fault in SILENCES + NUISANCES:
        fault.measure(rig)
        if rig.process.poll() is not None:
            check(f"{fault.name}: the program goes on", False)
            print("\n".join(list(rig.said)[-5:]))
            rig.start()
        rig.track()
        time.sleep(2)
    restart(rig)
    check("ends on SIGTERM", rig.end() == 0)


def quantile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


def pause(rig):
    os.kill(rig.process.pid, signal.SIGSTOP)
    time.sleep(3)
    os.kill(rig.process.pid, signal.SIGCONT)


def full_disk_for_a_while(rig):
    if rig.is_mounted:
        rig.fill_disk()
        time.sleep(5)
        rig.clear_disk()


def stop_and_start(rig):
    check_quietly("stop over HTTP", rig.post("/stop") == 202)


def check_quietly(what, passed):
    if not passed:
        check(what, False)


def timed(mode, lasts):
    def run(rig):
        rig.camera.mode = mode
        time.sleep(lasts)
        rig.camera.mode = "live"

    return run


def killed_decoder(rig):
    for pid in rig.ffmpeg():
        os.kill(pid, signal.SIGKILL)


SOAK = [
    ("silent stream", timed("frozen", 6)),
    ("stream that ends", timed("closed", 5)),
    ("killed ffmpeg", killed_decoder),
    ("noise in the stream", timed("garbage", 2)),
    ("one picture for ever", timed("repeated", 5)),
    ("other size", timed("small", 4)),
    ("damaged pictures", timed("damaged", 5)),
    ("three pictures a second", timed("slow", 8)),
    ("full disk", full_disk_for_a_while),
    ("link gone", link_down),
    ("link asleep", link_sleeps),
    ("crowd", crowded),
    ("noise on MAVLink", noisy),
    ("stop and start", stop_and_start),
    ("program held for 3 s", pause),
]


# Largest growth from one round of faults to the next, and after the first round at all. A leak
# grows in every round; a buffer that grows once to its bound does so in one of them.
ROUND = len(SOAK)
MAX_GROWTH = {"MB": 0.7, "threads": 0.5, "files": 0.5}
MAX_STEP = {"MB": 8, "threads": 2, "files": 2}


def growth(values):
    """Growth a round: for each fault of a round the least between two rounds, their middle one.

    The first round is left out, since it is the one that fills buffers. `None` for fewer than three
    further rounds: a single step must not look like steady growth.
    """
    least = []
    for place in range(ROUND):
        tries = values[place::ROUND][1:]
        if len(tries) >= 3:
            least.append(min(b - a for a, b in zip(tries, tries[1:])))
    return sorted(least)[len(least) // 2] if len(least) > ROUND // 2 else None


def test_growth():
    """A leak of 100 KB a fault is found among noise and steps; noise and steps are no leak."""
    chance = random.Random(3)
    for leak, step, is_leak in ((0, 0, False), (0, 14, False), (0.1, 0, True), (0.1, 14, True)):
        for rounds in (4, 5, 8):
            values, value = [], 58.0
            for index in range(rounds * ROUND):
                value += leak + (step if index == 2 * ROUND + 3 else 0)
                values.append(value + chance.uniform(-0.2, 0.2))
            found = growth(values)
            assert (found > MAX_GROWTH["MB"]) == is_leak, (leak, step, rounds, found)


def judge_growth(rows):
    """Checks that memory, threads and open files do not grow with the number of faults."""
    # A run that is shorter than a round counts as warm after its half.
    warm = rows[ROUND:] or rows[len(rows) // 2 :]
    for column, (unit, most) in enumerate(MAX_STEP.items()):
        first, final = warm[0][column], warm[-1][column]
        check(
            f"after the first round {first:.1f} {unit}, in the end {final:.1f}",
            final - first <= most,
        )
        found = growth([row[column] for row in rows])
        if found is None:
            print(f"        {unit}: too short to tell a leak, which takes {4 * ROUND} faults")
        else:
            check(f"growth a round: {found:.2f} {unit}", found <= MAX_GROWTH[unit])


def soak(program, length, options, every, only):
    """One fault after the other, for so many seconds."""
    test_growth()
    chosen = [fault for fault in SOAK if not only or fault[0] in only]
    rig = begin(program, *options)
    start = time.monotonic()
    rows, faults, calm = [], 0, []
    runaway = 0.0
    while time.monotonic() - start < length and rig.process.poll() is None:
        name, fault = chosen[faults % len(chosen)]
        faults += 1
        minute = time.monotonic()
        before = len(rig.ages)
        fault(rig)
        after = time.monotonic()
        recovered = rig.wait(
            after, "line", lambda line: line["state"] == "tracking" and line.get("box"), 15
        )
        if recovered is None:
            rig.track()
            recovered = rig.wait(
                after, "line", lambda line: line["state"] == "tracking" and line.get("box"), 15
            )
        # While no box is reported, nothing may move for longer than the stall time-out.
        boxes = [
            at
            for at, what, value in list(rig.heard)
            if at >= minute and what == "line" and value.get("box")
        ]
        moves = [
            at
            for at, what, value in list(rig.heard)
            if at >= minute and what == "rates" and moving(value)
        ]
        for at in moves:
            # The first rate after a silence overtakes the line that it belongs to.
            earlier = [box for box in boxes if box <= at + 0.3]
            if earlier:
                runaway = max(runaway, at - earlier[-1])
        # Ages of the calm part of the minute, and of all of it.
        calm_from = len(rig.ages)
        time.sleep(
            max(0, min(every - (time.monotonic() - minute), start + length - time.monotonic()))
        )
        calm += rig.ages[calm_from:]
        memory, threads, files = rig.figures()
        rows.append((memory, threads, files))
        print(
            f"        {time.monotonic() - start:6.0f} s {name}: again after {seconds(recovered)}, {len(rig.ages) - before} reports, "
            f"{memory:.1f} MB, {threads} threads, {files} files",
            flush=True,
        )
        check_quietly(f"{name}: tracking comes again", recovered is not None)
    check("the program lives", rig.process.poll() is None)
    ages = rig.ages
    print(
        f"        {faults} faults, {len(ages)} reports; age p50 {quantile(ages, 0.5):.0f} ms, p99 {quantile(ages, 0.99):.0f} ms, "
        f"at most {max(ages, default=0):.0f} ms; between faults p50 {quantile(calm, 0.5):.0f} ms, p99 {quantile(calm, 0.99):.0f} ms"
    )
    check(
        f"no report is older than its time ({max(ages, default=0):.0f} ms)",
        max(ages, default=0) <= 1000 * MAX_AGE + 100,
    )
    check(
        f"no rate follows the last box by more than the stall time-out ({runaway:.2f} s)",
        runaway < STALL,
    )
    judge_growth(rows)
    size = (
        sum(os.path.getsize(os.path.join(rig.folder, name)) for name in os.listdir(rig.folder))
        / 2**20
    )
    check(f"logs stay below their total ({size:.1f} of 8 MB)", size < 9.1)
    check("ends on SIGTERM", rig.end() == 0)


def main():
    parser = argparse.ArgumentParser(description="Faults in front of `track-cpu serve`.")
    parser.add_argument("program", nargs="?", default="target/release/track-cpu")
    parser.add_argument(
        "--soak", type=float, metavar="SECONDS", help="one fault a minute, for so long"
    )
    parser.add_argument(
        "--every", type=float, default=60, metavar="SECONDS", help="time from fault to fault"
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=[name for name, _ in SOAK],
        help="soak with this fault alone; may be repeated",
    )
    parser.add_argument("--model", help="built-in model or weights file")
    args = parser.parse_args()
    options = ["--model", args.model] if args.model else []
    if args.soak:
        soak(args.program, args.soak, options, args.every, args.only)
    else:
        table(args.program, options)
    print(f"{len(failures)} failed" if failures else "all passed")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
