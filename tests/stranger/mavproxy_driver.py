"""A MAVProxy of our own, typed to through a pipe, with an ear on its --out port."""

import os
import re
import subprocess
import sys
import tempfile
import threading
import time

os.environ["MAVLINK20"] = "1"
from check import check  # noqa: E402
from pymavlink import mavutil  # noqa: E402

# However fast the vehicle, MAVProxy runs in real time, on a machine that may be busy.
LEAST_S = 20.0


class MavProxy:
    """MAVProxy on `master` (as MAVProxy writes links), passing everything on to UDP port `out` of this machine."""

    def __init__(self, master, out, speed, *options):
        self.speed = speed
        self.ear = mavutil.mavlink_connection(f"udpin:127.0.0.1:{out}", dialect="all")
        # Home is where MAVProxy keeps its settings: not this user's.
        self.home = tempfile.TemporaryDirectory()
        program = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        self.process = subprocess.Popen(
            [sys.executable, program, f"--master={master}", f"--out=udpout:127.0.0.1:{out}", "--mav20", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=self.home.name,
            env={**os.environ, "HOME": self.home.name, "PYTHONUNBUFFERED": "1"},
            text=True,
        )
        self.lines = []
        self.messages = []
        # Where in `messages` the last thing was typed, and the place behind the last message waited for.
        self.typed = 0
        self.seen = 0
        # Where in `lines` the last thing was typed.
        self.shown = 0
        self.news = threading.Condition()
        for target in (self._read, self._hear):
            threading.Thread(target=target, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            with self.news:
                self.lines.append(line.removeprefix("MAV> ").rstrip())
                self.news.notify_all()

    def _hear(self):
        while True:
            message = self.ear.recv_match(blocking=True, timeout=1.0)
            if message is not None:
                with self.news:
                    self.messages.append(message)
                    self.news.notify_all()

    def type(self, line):
        """One line, as at its prompt."""
        print(f"MAV> {line}", flush=True)
        with self.news:
            self.typed = self.seen = len(self.messages)
            self.shown = len(self.lines)
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def said(self, pattern, simulated_s, what, since=0):
        """A line of MAVProxy's own output, said since its start or line `since`."""
        end = time.monotonic() + max(simulated_s / self.speed, LEAST_S)
        found = None
        with self.news:
            while found is None:
                # The prompt and modes stand before what is said, on the same line.
                found = next((line for line in self.lines[since:] if re.search(pattern, _bare(line))), None)
                left = end - time.monotonic()
                if found is None and (left <= 0 or not self.news.wait(left)):
                    break
        if found is None:
            print("\n".join(f"     mavproxy: {line}" for line in self.lines[-25:]), flush=True)
        check(found is not None, what + (f' ("{_bare(found)}")' if found else f": never said {pattern!r}"))
        return found

    def wait(self, kind, accept, simulated_s, what, since_typed=False):
        """A message that MAVProxy passes on, after the last one waited for (or since the last line was typed)."""
        end = time.monotonic() + max(simulated_s / self.speed, LEAST_S)
        with self.news:
            at = self.typed if since_typed else self.seen
            while True:
                for at in range(at, len(self.messages)):
                    message = self.messages[at]
                    if message.get_type() == kind and accept(message):
                        self.seen = max(self.seen, at + 1)
                        check(True, what)
                        return message
                at = len(self.messages)
                left = end - time.monotonic()
                if left <= 0 or not self.news.wait(left):
                    break
        print("\n".join(f"     mavproxy: {line}" for line in self.lines[-25:]), flush=True)
        check(False, what)
        return None

    def __enter__(self):
        try:
            # It takes seconds to start.
            self.said("Detected vehicle", 60.0 * self.speed, "MAVProxy hears a vehicle")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends MAVProxy."""
        self.process.terminate()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.home.cleanup()


def _bare(line):
    """A line without the prompts that stand before it."""
    return re.sub(r"^(?:[A-Z0-9_]*> )+", "", line)
