#!/usr/bin/env python3
"""Other people's clients against `track-cpu serve`: MAVSDK, MAVProxy, plain HTTP.

    python3 -m venv v && v/bin/pip install pymavlink mavsdk MAVProxy
    v/bin/python tests/clients.py target/release/track-cpu

Each check prints a line, and a client that is not installed is skipped; the exit code is 1 if any
check fails. A ground station of pymavlink is in ground_station.py, a browser in web_page.py, and
faults.py has both in bad weather.
"""

import argparse
import http.client
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time

os.environ["MAVLINK20"] = "1"

FLIGHT = ["--input", "flight:seed=7,difficulty=easy,size=320x180", "--fps", "10", "--quiet"]
PATIENCE = ["--max-age-ms", "2000", "--stall-ms", "8000"]
TOKEN = "client-token"
VIEWERS, SLOW = 64, 80
failures = []


def check(what, passed):
    print(("ok      " if passed else "FAILED  ") + what, flush=True)
    if not passed:
        failures.append(what)


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Program:
    """A running `serve`, and what it says."""

    def __init__(self, program, *options):
        command = [program, "serve", *FLIGHT, *PATIENCE, *options]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE)
        self.said = []
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stderr:
            self.said.append(line.decode(errors="replace").rstrip())

    def end(self):
        self.process.terminate()
        return self.process.wait(timeout=20)


def until(ask, seconds=20):
    end = time.time() + seconds
    while time.time() < end:
        if answer := ask():
            return answer
        time.sleep(0.05)
    return None


def autopilot(port, mavutil):
    """The heartbeat without which MAVSDK takes no system for a vehicle."""
    link = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=1, source_component=1
    )

    def beat():
        while True:
            link.mav.heartbeat_send(2, 12, 81, 4, 4)
            time.sleep(1)

    threading.Thread(target=beat, daemon=True).start()


def mavsdk(program):
    """MAVSDK with its default system id, 245, which may ask; and may control once it is allowed."""
    try:
        from mavsdk import ComponentType, Configuration, Mavsdk
        from mavsdk.plugins.camera import Camera
        from pymavlink import mavutil
    except ImportError:
        print("skipped: mavsdk and pymavlink are not installed")
        return
    for allowed in (False, True):
        port = free_port(socket.SOCK_DGRAM)
        options = ["--mav-allow", "255,245"] if allowed else []
        running = Program(program, "--mavlink", f"udpout:127.0.0.1:{port}", *options)
        autopilot(port, mavutil)
        sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = until(lambda: next((s for s in sdk.get_systems() if s.has_camera()), None))
        check(
            f"MAVSDK {'allowed' if allowed else 'by default'}: finds a camera", system is not None
        )
        if system is None:
            running.end()
            continue
        camera = Camera(system)
        check("MAVSDK: lists it", until(lambda: len(camera.camera_list().cameras) == 1) is not None)

        def command(call, *numbers):
            try:
                call(*numbers)
                return "accepted"
            except Exception as error:  # of MAVSDK's own kind
                return str(error)

        result = command(camera.track_rectangle, 100, 0.44, 0.39, 0.56, 0.55)
        time.sleep(0.5)
        named = [line for line in running.said if "--mav-allow" in line and "245" in line]
        if allowed:
            check(f"MAVSDK allowed: track_rectangle is {result}", result == "accepted")
            result = command(camera.track_stop, 100)
            check(f"MAVSDK allowed: track_stop is {result}", result == "accepted")
            check("MAVSDK allowed: nothing is said", not named)
        else:
            check(
                f"MAVSDK by default: track_rectangle is {result[:60]}",
                result != "accepted" and "TIMEOUT" not in result.upper(),
            )
            command(camera.track_stop, 100)
            check(f"MAVSDK by default: said once: {named[:1]}", len(named) == 1)
        check("MAVSDK: the program ends", running.end() == 0)


def mavproxy(program):
    """MAVProxy's module `camera`, by its command line."""
    executable = shutil.which("mavproxy.py") or os.path.join(
        os.path.dirname(sys.executable), "mavproxy.py"
    )
    if not os.path.exists(executable):
        print("skipped: MAVProxy is not installed")
        return
    port = free_port(socket.SOCK_DGRAM)
    running = Program(
        program,
        "--mavlink",
        f"udpout:127.0.0.1:{port}",
        "--video-uri",
        "rtsp://127.0.0.1:8554/main",
    )
    command = [
        sys.executable,
        executable,
        f"--master=udpin:127.0.0.1:{port}",
        "--nowait",
        "--default-modules=camera",
    ]
    pipe = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    proxy = subprocess.Popen(command, cwd=tempfile.mkdtemp(), **pipe)
    words = []
    threading.Thread(
        target=lambda: [words.append(line.decode(errors="replace")) for line in proxy.stdout],
        daemon=True,
    ).start()

    def listed():
        proxy.stdin.write(b"camera status\ncamera streams\n")
        proxy.stdin.flush()
        time.sleep(2)
        return next(
            (line.strip() for line in words if "track-cpu" in line and "streams=1" in line), None
        )

    found = until(listed, 40)
    check(f"MAVProxy lists the camera: {found}", found is not None)
    streams = [line.strip() for line in words if "rtsp://127.0.0.1:8554/main" in line]
    check(f"MAVProxy knows the stream: {streams[-1:]}", streams)
    proxy.kill()
    proxy.wait(timeout=20)
    check("MAVProxy: the program ends", running.end() == 0)


class Site:
    """The web page of a running program, by plain HTTP."""

    def __init__(self, port):
        self.port = port

    def ask(self, method, path, headers=None, body=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read() if path != "/video" else b""
        except (OSError, http.client.HTTPException):
            return 0, {}, b""
        finally:
            connection.close()

    def frame(self):
        status, _, body = self.ask("GET", "/state")
        return json.loads(body).get("frame", -1) if status == 200 else -1

    def stop(self):
        return self.ask("POST", "/stop", {"X-Token": TOKEN})[0]


def page(program):
    """Other sites, slow clients, and many viewers."""
    port = free_port(socket.SOCK_STREAM)
    running = Program(program, "--http", f"127.0.0.1:{port}", "--token", TOKEN)
    site = Site(port)
    check("page: frames come", until(lambda: site.frame() > 2) is not None)
    for path in ("/", "/state", "/video", "/frame", "/events"):
        status = site.ask("GET", path, {"Host": "evil.example"})[0]
        check(f"page: {path} under another site's name is refused ({status})", status == 421)
    status, headers, _ = site.ask("GET", "/state")
    check(
        "page: no other site may embed it",
        headers.get("Cross-Origin-Resource-Policy") == "same-origin",
    )
    check("page: no other site may read it", headers.get("Access-Control-Allow-Origin") is None)

    held = []
    for index in range(VIEWERS):
        viewer = socket.create_connection(("127.0.0.1", port), 5)
        viewer.sendall(
            f"GET {['/video', '/events'][index % 2]} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
        )
        held.append(viewer)  # never reads
    before = site.frame()
    time.sleep(3)
    after = site.frame()
    check(
        f"page: {VIEWERS} viewers that never read hold up nothing ({after - before} frames in 3 s)",
        after - before >= 15,
    )
    check("page: Stop gets through them", site.stop() == 202)
    for viewer in held:
        viewer.close()

    slow = []
    answers, times = [], []
    end = time.time() + 10
    while time.time() < end:
        while len(slow) < SLOW:
            try:
                connection = socket.create_connection(("127.0.0.1", port), 2)
                connection.sendall(b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: ")
                slow.append(connection)
            except OSError:
                break
        for connection in list(slow):
            try:
                connection.sendall(b"a")
            except OSError:
                slow.remove(connection)
        began = time.time()
        answers.append(site.stop() == 202)
        times.append(time.time() - began)
        time.sleep(0.2)
    check(
        f"page: Stop gets through {SLOW} slow connections, {sum(answers)} of {len(answers)}, at most {max(times):.2f} s",
        all(answers),
    )
    check("page: the program ends", running.end() == 0)


def main():
    parser = argparse.ArgumentParser(
        description="Other people's clients against `track-cpu serve`."
    )
    parser.add_argument("program", nargs="?", default="target/release/track-cpu")
    args = parser.parse_args()
    page(args.program)
    mavsdk(args.program)
    mavproxy(args.program)
    print(f"{len(failures)} failed" if failures else "all passed")
    sys.stdout.flush()
    os._exit(bool(failures))  # MAVSDK's threads have no end


if __name__ == "__main__":
    main()
