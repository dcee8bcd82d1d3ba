"""The sender of one camera in a process of its own, with faults: options are a dictionary in JSON on the command line."""

import itertools
import json
import queue
import random
import sys
import threading
import time

import zenoh
from pictures import DATA

from pardalis.zenoh import Sender


class Faulty:
    """A publisher behind a network that loses messages, delays each by up to `max_delay_s` in order, and some by far more."""

    def __init__(self, publisher, seed, max_delay_s, lost, late):
        self.publisher, self.max_delay_s, self.lost, self.late = publisher, max_delay_s, lost, late
        self.random = random.Random(seed)
        self.number, self.free_s = 0, 0.0
        self.messages = queue.PriorityQueue()
        threading.Thread(target=self.deliver, daemon=True).start()

    def put(self, payload, attachment):
        number, self.number = self.number, self.number + 1
        if number in self.lost:
            return
        now_s = time.monotonic()
        if number in self.late:
            at_s = now_s + 0.4
        else:
            at_s = self.free_s = max(self.free_s, now_s + self.random.uniform(0, self.max_delay_s))
        self.messages.put((at_s, number, payload, attachment))

    def deliver(self):
        while True:
            message = self.messages.get()
            at_s, _, payload, attachment = message
            if at_s > time.monotonic():
                # An earlier one may come meanwhile.
                self.messages.put(message)
                time.sleep(0.001)
            else:
                self.publisher.put(payload, attachment=attachment)


def config(**endpoints):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    # In microseconds. By default Zenoh drops what a busy computer has not sent within 1 ms, and only the injected losses are wanted here.
    config.insert_json5("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "300000")
    for name in ("listen", "connect"):
        config.insert_json5(f"{name}/endpoints", json.dumps([endpoints[name]] if name in endpoints else []))
    return config


if __name__ == "__main__":
    options = json.loads(sys.argv[1])
    clock_ns = time.time_ns
    time.time_ns = lambda: clock_ns() + options.get("clock_error_ns", 0)
    files = sorted((DATA / "webcams-four" / "frames" / options["camera"]).glob("*.jpg"))
    images = [file.read_bytes() for file in files]
    with zenoh.open(config(connect=options["connect"])) as session, Sender(options["camera"], session=session) as sender:
        if "max_delay_s" in options:
            sender._publisher = Faulty(sender._publisher, options["camera"], options["max_delay_s"], options["lost"], options["late"])
        begin_s = options["begin_s"]
        for number in range(options["count"]) if "count" in options else itertools.count():
            time_s = begin_s + number / 25
            time.sleep(max(time_s - clock_ns() * 1e-9, 0))
            if "max_delay_s" in options:
                sender.send(images[number % len(images)], time_s)
            else:
                sender.send(images[number % len(images)])
        time.sleep(1)
