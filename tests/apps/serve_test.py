#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""jade_train --serve and jade_view from the command line: viewers of all kinds, Ctrl-C, mistakes, and bit-identical
results.

    serve_test.py BIN_FOLDER        exits with 77 if the programs were built without a web server
"""
import hashlib
import http.client
import json
import math
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

SIMULATION = """
seed: 3
simulate: {world: desk, width: 48, height: 36, focal_px: 62, exposures: 3, test_views: 1, seen_test_views: 1, motion: {blur_px: 4}}
"""
TRAINING = f"""
extends: {Path(__file__).resolve().parents[2] / "configs" / "paper.yaml"}
device: cpu
events: {{threshold_positive: 0.25}}
objective: {{target: edi, warmup: 20}}
init: {{points: 300}}
densify: {{every: 20, until: 100%, max_gaussians: 600, gradient_threshold: 1e-5}}
train: {{iterations: 150, log_every: 5, evaluate_every: 50, picture_every: 0}}
"""
FRAME = "frame?viewer={}&layer=color&pose=1,0,0,0,0,1,0,0,0,0,1,0&camera=62,62,24,18,48,36"


def expect(condition, what):
    if not condition:
        raise AssertionError(what)


def ask(url, method="GET"):
    """Status and bytes of an answer; (0, b'') without an answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, method=method, data=b"" if method == "POST" else None), timeout=30) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()
    except (OSError, EOFError):
        return 0, b""


def state(url, viewer="a"):
    return json.loads(ask(f"{url}state?viewer={viewer}&generation=-1&from=0")[1])


def wait_for(condition, what, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        expect(time.monotonic() < end, f"not within {seconds} s: {what}")
        time.sleep(0.05)


class Served:
    """A program that serves, and the address that it prints."""

    def __init__(self, *command):
        self.errors = tempfile.TemporaryFile(mode="w+")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.errors, text=True)
        self.url = self.process.stdout.readline().strip()
        expect(re.fullmatch(r"http://\S+:\d+/\S*", self.url), f"expected an address, found '{self.url}': {self.said()}")

    def said(self):
        self.errors.seek(0)
        return self.errors.read()

    def end(self):
        """Waits for the program; returns its exit code."""
        self.process.stdout.close()
        return self.process.wait(timeout=120)

    def interrupt(self):
        """Sends Ctrl-C; returns the exit code, and the seconds until it ended."""
        start = time.monotonic()
        self.process.send_signal(signal.SIGINT)
        return self.end(), time.monotonic() - start


class Runs:
    def __init__(self, programs, folder):
        self.programs, self.folder = programs, folder
        (folder / "simulation.yaml").write_text(SIMULATION)
        (folder / "training.yaml").write_text(TRAINING)
        self.run("jade_simulate", "--config", folder / "simulation.yaml", "--output", folder / "data")

    def program(self, name, *arguments):
        return [self.programs / name, *arguments]

    def training(self, output, *more):
        return self.program("jade_train", "--config", self.folder / "training.yaml", "--set",
                            f"dataset.path={self.folder / 'data'}", "--output", self.folder / output, *more)

    def run(self, *command):
        done = subprocess.run(self.program(*command), capture_output=True, text=True)
        expect(done.returncode == 0, f"{command[0]}: {done.stderr}")

    def bits(self, output):
        return hashlib.sha256((self.folder / output / "point_cloud.ply").read_bytes()).hexdigest()


def look(url, viewer, seen, stop):
    while not stop.is_set():
        status, body = ask(url + FRAME.format(viewer))
        if status == 200 and body.startswith(b"\xff\xd8"):
            seen[viewer] = seen.get(viewer, 0) + 1
        elif status != 204:
            time.sleep(0.05)


def stall(url, viewer):
    """A viewer that sends a request and never reads; returns its connection."""
    connection = socket.create_connection(("127.0.0.1", port_of(url)))
    connection.sendall(f"GET /{FRAME.format(viewer)} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
    return connection


def port_of(url):
    return int(re.search(r":(\d+)/", url)[1])


def raw(url, request):
    """The first line of the answer to these bytes; empty if the server closed the connection."""
    with socket.create_connection(("127.0.0.1", port_of(url)), timeout=30) as connection:
        try:
            connection.sendall(request)
            return connection.recv(200).split(b"\r\n")[0].decode()
        except ConnectionError:
            return ""


def misuse(url):
    """Invalid requests, and connections that stay open without sending anything."""
    ask_state = b"GET /state?viewer=a&generation=-1&from=0 HTTP/1.1\r\n"
    for what, request, answer in (
            ("another Host", ask_state + b"Host: example.org\r\n\r\n", "HTTP/1.1 421 Misdirected Request"),
            ("another page", ask_state + b"Host: 127.0.0.1\r\nOrigin: http://example.org\r\n\r\n", "HTTP/1.1 403 Forbidden"),
            ("a long address", b"GET /" + 20000 * b"a" + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", ""),
            ("a long body", b"POST /pause HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000\r\n\r\n" + 100000 * b"x",
             "HTTP/1.1 413 Payload Too Large")):
        found = raw(url, request)
        expect(found == answer, f"{what}: expected '{answer}', found '{found}'")
    return [socket.create_connection(("127.0.0.1", port_of(url))) for _ in range(4)]


def flood(url, count, half):
    """Sends `count` requests in four threads; training waits at the step `half` until they are done."""
    bad, held = [], threading.Event()

    def part(viewer):
        connection = http.client.HTTPConnection("127.0.0.1", port_of(url), timeout=30)
        for _ in range(count // 4):
            connection.request("GET", f"/state?viewer={viewer}&generation=-1&from=0")
            answer = connection.getresponse()
            body = answer.read()
            if answer.status != 200:
                bad.append(answer.status)
            elif json.loads(body)["step"] >= half and not held.is_set():
                held.set()
                ask(f"{url}pause?viewer=a&on=1", "POST")

    parts = [threading.Thread(target=part, args=(f"flood{k}",)) for k in range(4)]
    for each in parts:
        each.start()
    for each in parts:
        each.join()
    expect(bad == [], f"{count} requests, of which some were answered by {bad[:5]}")
    ask(f"{url}pause?viewer=a&on=0", "POST")


def check_same_bits(runs):
    """Trains with two viewers, some that stall or leave, a pause, rejected requests and 10,000 accepted ones."""
    done = subprocess.run(runs.training("alone"), capture_output=True, text=True)
    expect(done.returncode == 0, done.stderr)
    served = Served(*runs.training("served", "--serve=0"))
    url, seen, stop = served.url, {}, threading.Event()
    # Immediately: a fast machine finishes 150 steps quickly.
    expect(ask(f"{url}pause?viewer=a&on=1", "POST")[0] == 204, "pause")
    viewers = [threading.Thread(target=look, args=(url, name, seen, stop)) for name in "ab"]
    for viewer in viewers:
        viewer.start()
    stalled = [stall(url, f"stalls{k}") for k in range(3)]
    stall(url, "leaves").close()
    wait_for(lambda: state(url)["phase"] == "paused", "paused")
    step = state(url)["step"]
    before = seen.get("a", 0)
    wait_for(lambda: seen.get("a", 0) > before + 3, "frames while paused")
    expect(state(url)["step"] == step, "no step while paused")
    expect(ask(f"{url}pause?viewer=a&on=0", "POST")[0] == 204, "go on")
    stalled += misuse(url)
    flood(url, 10000, 75)
    lines = []
    while served.process.poll() is None:
        status, body = ask(f"{url}state?viewer=a&generation=-1&from=0")
        lines = json.loads(body)["lines"] if status == 200 else lines
        time.sleep(0.05)
    stop.set()
    for viewer in viewers:
        viewer.join()
    for connection in stalled:
        connection.close()
    expect(served.end() == 0, served.said())
    expect(min(seen.get("a", 0), seen.get("b", 0)) > 3, f"both viewers see: {seen}")
    expect(len(lines) > 5 and any("test_psnr" in line for line in lines), "metrics come while it trains")
    expect(runs.bits("alone") == runs.bits("served"), "the same bits with viewers and without")
    print(f"same bits; frames {seen}")


def check_interrupt(runs):
    served = Served(*runs.training("stopped", "--set", "train.iterations=100000", "--serve=0"))
    seen, stop = {}, threading.Event()
    viewer = threading.Thread(target=look, args=(served.url, "a", seen, stop))
    viewer.start()
    stalled = stall(served.url, "stalls")
    wait_for(lambda: seen.get("a", 0) > 2, "frames")
    code, seconds = served.interrupt()
    stop.set()
    viewer.join()
    stalled.close()
    expect(code == 130, f"expected 130, found {code}: {served.said()}")
    expect(f"go on with {runs.programs}/jade_train --output {runs.folder}/stopped --resume" in served.said(), f"the command as called: {served.said()}")
    expect(seconds < 10, f"{seconds:.1f} s to stop")
    expect(list((runs.folder / "stopped/checkpoints").glob("step_*.pt")), "saved before the end")


def check_mistakes(runs):
    """Mistakes give one line and exit code 2, and create nothing."""
    def fails(what, code, *command):
        done = subprocess.run(command, capture_output=True, text=True)
        expect(done.returncode == code and done.stderr.count("\n") == 1 and what in done.stderr,
               f"expected {code} and '{what}', found {done.returncode} and {done.stderr}")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        fails("Address already in use; choose another port", 2, *runs.training("none", f"--serve={port}"))
    fails("--serve 127.0.0.1:http: expected an IP address and a port", 2, *runs.training("none", "--serve=127.0.0.1:http"))
    fails("--serve example.org: expected an IP address", 2, *runs.training("none", "--serve=example.org"))
    fails("--serve example.org:80: expected an IP address", 2, *runs.training("none", "--serve", "example.org:80"))
    fails("found nothing", 3, *runs.program("jade_view", runs.folder / "nothing", "--serve", "localhost:0"))
    expect(not (runs.folder / "none").exists(), "no run directory")
    fails("example.org: expected the folder of a data set", 3, *runs.training("none", "--serve", "example.org"))
    done = subprocess.run(runs.program("jade_view", "--serve", runs.folder / "nothing"), capture_output=True, text=True)
    expect(done.returncode != 0 and ("found nothing" in done.stderr or "already in use" in done.stderr), f"the word after --serve is the scene: {done.stderr}")
    fails("expected a run directory of jade_train or a file of Gaussians, found nothing", 3, *runs.program("jade_view", runs.folder / "nothing", "--serve=0"))
    fails("expected a run directory of jade_train or a file of Gaussians, found another folder", 3, *runs.program("jade_view", runs.folder / "data", "--serve=0"))


def check_view(runs):
    for scene, picture in (("served", "picture?viewer=a&view=train.0&name=blurry"), ("served/point_cloud.ply", None)):
        view = Served(*runs.program("jade_view", runs.folder / scene, "--device", "cpu", "--serve=0"))
        wait_for(lambda: b'"live"' in ask(view.url)[1], "the page")
        expect(state(view.url)["phase"] == "still", "a scene that is as it is")
        wait_for(lambda: ask(view.url + FRAME.format("a"))[1].startswith(b"\xff\xd8"), f"a frame of {scene}")
        if picture:
            expect(ask(view.url + picture)[1][1:4] == b"PNG", "a picture")
            wait_for(lambda: ask(view.url + picture.replace("blurry", "EDI"))[1][1:4] == b"PNG", "a restoration")
        code, seconds = view.interrupt()
        expect(code == 130 and seconds < 5, f"jade_view ends with Ctrl-C: {code} after {seconds:.1f} s")


def write_scene(path, scale, count=200):
    """A .ply of `count` Gaussians on a helix about the origin, `scale` wide and of many colours."""
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rows = []
    for i in range(count):
        place = [scale * math.cos(i), scale * math.sin(i), scale * (2 * i / count - 1)]
        rows += [*place, math.cos(3 * i), math.cos(5 * i), math.cos(7 * i), 4, *3 * [math.log(0.2 * scale)], 1, 0, 0, 0]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n" + "".join(f"property float {n}\n" for n in names)
    path.write_bytes((head + "end_header\n").encode() + struct.pack(f"<{len(rows)}f", *rows))


def check_small_scene(runs):
    """A scene that is nearer to its overview camera than the default near plane is visible; one without Gaussians is
    rejected.
    """
    write_scene(runs.folder / "small.ply", 1e-3)
    view = Served(*runs.program("jade_view", runs.folder / "small.ply", "--device", "cpu", "--serve=0"))
    wait_for(lambda: b'"live"' in ask(view.url)[1], "the page")

    def frame(depth):
        answers = [b""]
        at = FRAME.format("a").replace("0,0,1,0&", f"0,0,1,{depth}&")
        wait_for(lambda: answers.append(ask(view.url + at)[1]) or answers[-1].startswith(b"\xff\xd8"), "a frame")
        return answers[-1]

    expect(frame(0.004) != frame(-1), "a small scene before the camera is not black, as one behind it is")
    view.interrupt()
    write_scene(runs.folder / "none.ply", 1, 0)
    done = subprocess.run(runs.program("jade_view", runs.folder / "none.ply", "--device", "cpu", "--serve=0"), capture_output=True,
                          text=True)
    expect(done.returncode == 3 and "none.ply: expected Gaussians, found none" in done.stderr, f"{done.returncode}: {done.stderr}")


def main():
    programs = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(programs, Path(folder))
        probe = subprocess.run(runs.training("probe", "--serve=127.0.0.1:0", "--set", "dataset.path=/nowhere"), capture_output=True, text=True)
        if "has no web server" in probe.stderr:
            print("SKIPPED: needs libcpp-httplib-dev: scripts/setup.sh; then configure and build again")
            return 77
        check_mistakes(runs)
        check_small_scene(runs)
        check_same_bits(runs)
        check_interrupt(runs)
        check_view(runs)
    print("it serves as it says")
    return 0


if __name__ == "__main__":
    sys.exit(main())
