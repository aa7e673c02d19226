"""A headless Chromium, controlled by the DevTools protocol over a pair of pipes."""

import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
OPTIONS = (
    "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync --disable-dev-shm-usage --hide-scrollbars"
    " --remote-debugging-pipe"
)


class Browser:
    """One running browser with one page; messages are JSON, ended by a zero byte."""

    def __init__(self, home):
        command_in, self._out = os.pipe()
        self._in, answer_out = os.pipe()
        # Chromium reads from descriptor 3 and writes to 4; those of the pipes are first put out of
        # their way
        shell = f'exec 13<&{command_in} 14>&{answer_out}; exec 3<&13 4>&14 13<&- 14>&-; exec "$@"'
        words = [CHROMIUM, *OPTIONS.split(), f"--user-data-dir={home}", "about:blank"]
        self._process = subprocess.Popen(
            ["bash", "-c", shell, "chromium", *words],
            pass_fds=(command_in, answer_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(command_in)
        os.close(answer_out)
        self._number = 0
        self._read = b""
        self.events = []
        target = self._send("Target.createTarget", url="about:blank")["targetId"]
        attached = self._send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def close(self):
        self._process.terminate()
        self._process.wait(20)
        os.close(self._out)
        os.close(self._in)

    def call(self, method, **params):
        return self._send(method, session=self._session, **params)

    def _send(self, method, session=None, **params):
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._number:
            self.events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self, seconds=60.0):
        end = time.monotonic() + seconds
        while b"\0" not in self._read:
            ready, _, _ = select.select([self._in], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser says nothing for {seconds} s"
            more = os.read(self._in, 1 << 20)
            assert more, "the browser has ended"
            self._read += more
        message, _, self._read = self._read.partition(b"\0")
        return json.loads(message)

    def open(
        self,
        path,
        width=1280,
        height=900,
        scheme="light",
        medium="screen",
        motion="no-preference",
    ):
        """Open a file; the events since then are in `events`."""
        self.events.clear()
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **screen)
        wishes = {"prefers-color-scheme": scheme, "prefers-reduced-motion": motion}
        features = [{"name": name, "value": value} for name, value in wishes.items()]
        self.call("Emulation.setEmulatedMedia", media=medium, features=features)
        self.call("Page.navigate", url=Path(path).resolve().as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self._next())

    def fits(self):
        """Whether the page is as wide as the window, and every picture is shown and described."""
        return self.run(
            "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
            " && [...document.images].every(i => !i.src || (i.complete && i.naturalWidth > 0))"
            " && [...document.querySelectorAll('figure img')].every(i => i.alt.trim().length > 0)"
        )

    def asked(self):
        """The addresses that the page has asked for, its own first."""
        requests = [e for e in self.events if e["method"] == "Network.requestWillBeSent"]
        return [event["params"]["request"]["url"] for event in requests]

    def complaints(self):
        """What the page has logged and thrown, and the addresses it has asked for besides its
        own."""
        methods = ("Log.entryAdded", "Runtime.consoleAPICalled", "Runtime.exceptionThrown")
        said = [e["params"] for e in self.events if e["method"] in methods]
        return said + [url for url in self.asked()[1:] if not url.startswith("data:")]

    def run(self, script):
        """The value of a script."""
        found = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def press(self, key, code):
        keys = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        text = {"text": "\r"} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **keys, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **keys)
