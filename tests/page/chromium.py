# SPDX-License-Identifier: Apache-2.0
"""A page in headless Chromium, controlled over the DevTools protocol through a pipe, with only the standard library."""
import base64
import json
import os
import re
import select
import shutil
import subprocess
import tempfile
import time

# Software WebGL2 on any machine.
FLAGS = ["--headless=new", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox",
         "--disable-dev-shm-usage", "--disable-background-networking", "--disable-component-update", "--no-first-run",
         "--remote-debugging-pipe"]


def find() -> str | None:
    """The browser, or None where there is none."""
    return next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)


class Chromium:
    """One browser with one page. `errors` collects errors of the console and the page."""

    def __init__(self, width=1000, height=800, flags=()):
        self.errors, self.requests, self.count, self.rest = [], [], 0, b""
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self.write_end = os.pipe()
        self.read_end, from_browser = os.pipe()
        # The browser reads commands from descriptor 3 and answers on 4; this process's own must not be in use.
        inbox, outbox = (os.dup(fd) for fd in (to_browser, from_browser))

        def place():
            high = [os.dup2(fd, 60 + k) for k, fd in enumerate((inbox, outbox))]
            for k, fd in enumerate(high):
                os.dup2(fd, 3 + k)
                os.close(fd)

        self.process = subprocess.Popen([find(), *FLAGS, *flags, f"--user-data-dir={self.profile.name}", "about:blank"],
                                        preexec_fn=place, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for fd in (to_browser, from_browser, inbox, outbox):
            os.close(fd)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = None
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page", "Network"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        os.close(self.read_end)
        os.close(self.write_end)
        self.profile.cleanup()

    def call(self, method, timeout=180, **parameters):
        """The result of one command."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if getattr(self, "session", None):
            message["sessionId"] = self.session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self.write_end, data):]
        number, end = self.count, time.monotonic() + timeout
        while True:
            answer = self.next_message(end, method)
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.note(answer)

    def next_message(self, end, method):
        while b"\0" not in self.rest:
            if not select.select([self.read_end], [], [], max(0, end - time.monotonic()))[0]:
                raise TimeoutError(f"{method}: no answer from Chromium")
            data = os.read(self.read_end, 1 << 20)
            if not data:
                raise RuntimeError(f"{method}: Chromium has gone")
            self.rest += data
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def note(self, event):
        parameters = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif event.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning"):
            self.errors.append(" ".join(str(argument.get("value")) for argument in parameters["args"]))
        elif event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])
        elif event.get("method") == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])

    def open(self, address, ready="document.documentElement?.dataset.ready"):
        """Loads a page and waits until the expression is true."""
        self.call("Page.navigate", url=address)
        return self.wait(ready)

    def wait(self, expression, seconds=180):
        """Waits until the expression is true. Its names need not exist yet, because a page may be loading another
        one.
        """
        end, problem = time.monotonic() + seconds, None
        while time.monotonic() < end:
            try:
                value = self.evaluate(expression)
            except RuntimeError as error:
                if not re.search("navigated|context|ReferenceError|TypeError", str(error), re.IGNORECASE):
                    raise
                value, problem = None, error
            if value:
                return value
            time.sleep(0.05)
        raise TimeoutError(f"not within {seconds} s: {expression}; last: {problem}; the page says {self.errors}")

    def evaluate(self, expression):
        """The value of an expression, awaited if it is a promise."""
        result = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            details = result["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description", details["text"]))
        return result["result"].get("value")

    def resize(self, width, height, mobile=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)

    def screenshot(self, kind="png", quality=None):
        more = {"quality": quality} if quality else {}
        return base64.b64decode(self.call("Page.captureScreenshot", format=kind, **more)["data"])

    def key(self, key, code=None, text=None):
        common = {"key": key, "code": code or key}
        self.call("Input.dispatchKeyEvent", type="keyDown", **common, **({"text": text} if text else {}))
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def drag(self, start, end, steps=5):
        """From one point of the window to another with the left button."""
        def mouse(kind, x, y, buttons):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)
        mouse("mousePressed", *start, 1)
        for k in range(1, steps + 1):
            mouse("mouseMoved", *(a + (b - a) * k / steps for a, b in zip(start, end)), 1)
        mouse("mouseReleased", *end, 0)
