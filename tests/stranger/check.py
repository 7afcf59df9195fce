"""What the strangers' programs share: checks that print what held, a limit of time, and one way to end."""

import _thread
import os
import sys
import threading
import time
import traceback


class CheckFailed(Exception):
    """A check did not hold."""


def check(condition, message):
    """Prints what held; raises what did not."""
    if not condition:
        raise CheckFailed(message)
    print(f"ok   {message}", flush=True)


def run(program, limit_s):
    """Runs `program`; ends this process with 0 if every check held, 1 otherwise or after `limit_s` of wall time."""

    def too_late():
        print(f"FAIL not done after {limit_s} s", flush=True)
        # So that `program` can end what it has started; if it is deaf, without it.
        _thread.interrupt_main()
        time.sleep(15.0)
        os._exit(1)

    watchdog = threading.Timer(limit_s, too_late)
    watchdog.daemon = True
    watchdog.start()
    try:
        program()
    except CheckFailed as failure:
        print(f"FAIL {failure}", flush=True)
        code = 1
    except BaseException:  # whatever a foreign library throws is a failure with its own words
        traceback.print_exc()
        print("FAIL stopped by the error above", flush=True)
        code = 1
    else:
        print("every check holds", flush=True)
        code = 0
    sys.stdout.flush()
    # Foreign threads must not keep this process alive.
    os._exit(code)
