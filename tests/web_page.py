#!/usr/bin/env python3
"""A browser at the web ground station of `track-cpu serve`.

    python3 -m venv v && v/bin/pip install playwright      # and Chromium: v/bin/playwright install chromium
    v/bin/python tests/web_page.py target/release/track-cpu [--chromium /usr/bin/chromium]

Draws a box on a rendered flight with the mouse and with a finger, watches the overlay follow, stops, tries without the
token, and times tracking while eight more look on. Every check prints a line; the exit code is 1 if any fails. Not part of
`cargo test`, which speaks the page's HTTP in Rust.
"""
import argparse
import json
import re
import statistics
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

from playwright.sync_api import sync_playwright

FLIGHT = "flight:seed=7,difficulty=easy,size=640x360,frames=100000"
FPS = "15"
VIEWERS = 8
failures = []


def check(what, passed):
    print(("ok      " if passed else "FAILED  ") + what, flush=True)
    if not passed:
        failures.append(what)


class Program:
    def __init__(self, program, *options):
        command = [program, "serve", "--input", FLIGHT, "--fps", FPS, "--quiet", "--http", "127.0.0.1:0", *options]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        for line in self.process.stderr:
            if found := re.search(r"web page: (http://([^/]+)/#(\S+))", line):
                self.page, self.address, self.token = found.groups()
                break
        threading.Thread(target=lambda: [None for _ in self.process.stderr], daemon=True).start()

    def state(self):
        with urllib.request.urlopen(f"http://{self.address}/state", timeout=5) as answer:
            return json.load(answer)

    def until(self, holds, seconds=20):
        end = time.time() + seconds
        while time.time() < end:
            if holds(self.state()):
                return True
            time.sleep(0.05)
        return False

    def work(self, seconds):
        """Median milliseconds that tracking takes per frame."""
        times, end, last = [], time.time() + seconds, None
        while time.time() < end:
            state = self.state()
            if state["frame"] != last:
                times.append(state["work_ms"])
            last = state["frame"]
            time.sleep(0.02)
        return statistics.median(times)

    def end(self):
        self.process.terminate()
        return self.process.wait(timeout=20)


def drawn(page):
    """Bounding box of what is drawn on the overlay, in its own pixels; None if nothing is."""
    return page.evaluate("""() => {
        const c = document.getElementById("overlay"), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
        let [x0, y0, x1, y1] = [1e9, 1e9, -1, -1];
        for (let y = 0; y < c.height; y++) for (let x = 0; x < c.width; x++) if (d[4 * (y * c.width + x) + 3] > 128) {
            x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
        }
        return x1 < 0 ? null : [x0 / c.width, y0 / c.height, x1 / c.width, y1 / c.height];
    }""")


def middle(box):
    return (box[0] + box[2]) / 2, (box[1] + box[3]) / 2


def shares(state):
    (w, h), (x, y, bw, bh) = state["size"], state["box"]
    return x / w, y / h, (x + bw) / w, (y + bh) / h


def desktop(browser, program):
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(program.page)
    page.wait_for_function("document.getElementById('video').naturalWidth > 0", timeout=20000)
    view = page.locator("#overlay").bounding_box()
    check("the video is shown", view["height"] > 300)
    x, y = view["x"] + 0.5 * view["width"], view["y"] + 0.5 * view["height"]
    page.mouse.move(x - 40, y - 30)
    page.mouse.down()
    page.mouse.move(x + 10, y + 10)
    page.mouse.move(x + 40, y + 30)
    page.mouse.up()
    check("a box drawn with the mouse starts", program.until(lambda s: s["state"] != "idle"))
    off = []
    for _ in range(20):
        time.sleep(0.15)
        box, state = drawn(page), program.state()
        if box and "box" in state:
            (a, b), (c, d) = middle(box), middle(shares(state))
            off.append(max(abs(a - c), abs(b - d)))
    check(f"the overlay follows ({len(off)} looks, at most {max(off, default=1):.3f} of the view off)", len(off) > 10 and statistics.median(off) < 0.03)
    check("the state is told", page.inner_text("#state") != "idle" and "ms" in page.inner_text("#numbers"))
    page.click("#stop")
    check("stop stops", program.until(lambda s: s["state"] == "idle"))
    page.wait_for_function("document.getElementById('state').textContent == 'idle'")
    check("nothing is drawn any more", drawn(page) is None)
    page.close()


def phone(browser, program):
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(program.page)
    page.wait_for_function("document.getElementById('video').naturalWidth > 0", timeout=20000)
    wide = page.evaluate("document.documentElement.scrollWidth")
    check(f"fits a phone ({wide} of 390 pixels)", wide <= 390)
    view = page.locator("#overlay").bounding_box()
    page.touchscreen.tap(view["x"] + 0.5 * view["width"], view["y"] + 0.5 * view["height"])
    check("a tap starts", program.until(lambda s: s["state"] != "idle"))
    stop = page.locator("#stop").bounding_box()
    check("the stop button is large enough for a finger", stop["height"] >= 32 and stop["width"] >= 44)
    page.tap("#stop")
    check("a tap stops", program.until(lambda s: s["state"] == "idle"))
    context.close()


def unauthorized(browser, program):
    page = browser.new_page()
    page.goto(f"http://{program.address}/")
    page.wait_for_function("document.getElementById('note').textContent.startsWith('Watching only')")
    view = page.locator("#overlay").bounding_box()
    page.mouse.move(view["x"] + 100, view["y"] + 100)
    page.mouse.down()
    page.mouse.move(view["x"] + 200, view["y"] + 180)
    page.mouse.up()
    page.wait_for_function("document.getElementById('note').textContent.includes('token')")
    check("without the token a box does not start", program.state()["state"] == "idle")
    page.close()
    for token in (None, "x" * 24):
        headers = {"X-Token": token} if token else {}
        request = urllib.request.Request(f"http://{program.address}/start", b'{"point":[0.5,0.5]}', headers)
        try:
            code = urllib.request.urlopen(request, timeout=5).status
        except urllib.error.HTTPError as error:
            code = error.code
        check(f"start with {'a wrong' if token else 'no'} token is refused", code == 403)


def viewers(program):
    """Watches video and events of everybody in turns with nobody."""
    request = urllib.request.Request(f"http://{program.address}/start", b'{"point":[0.5,0.5]}', {"X-Token": program.token})
    urllib.request.urlopen(request, timeout=5)
    alone, watched = [], []
    for _ in range(4):
        alone.append(program.work(4))
        ended, threads = threading.Event(), []

        def watch(path):
            with urllib.request.urlopen(f"http://{program.address}{path}", timeout=10) as stream:
                while not ended.is_set() and stream.read1(65536):
                    pass

        for path in ["/video", "/events"] * VIEWERS:
            threads.append(threading.Thread(target=watch, args=(path,), daemon=True))
            threads[-1].start()
        time.sleep(0.5)
        watched.append(program.work(4))
        ended.set()
        for thread in threads:
            thread.join()
        time.sleep(0.7)
    a, b = statistics.median(alone), statistics.median(watched)
    check(f"{VIEWERS} viewers slow tracking by {100 * (b / a - 1):.1f} % ({a:.2f} -> {b:.2f} ms)", b <= 1.05 * a)


def main():
    parser = argparse.ArgumentParser(description="A browser at the web ground station of `track-cpu serve`.")
    parser.add_argument("program", nargs="?", default="target/release/track-cpu")
    parser.add_argument("--chromium", help="the browser's program, if it is not Playwright's own")
    args = parser.parse_args()
    program = Program(args.program)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=args.chromium, args=["--no-sandbox"])
        desktop(browser, program)
        phone(browser, program)
        unauthorized(browser, program)
        browser.close()
    viewers(program)
    check("ends on SIGTERM", program.end() == 0)
    print(f"{len(failures)} failed" if failures else "all passed")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
