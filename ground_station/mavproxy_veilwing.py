"""MAVProxy module of veilwing: the operator's orders to the companions of the pair.

    module load veilwing
    veilwing start|pause|continue|return|kill|lift [SYSTEM]
    veilwing status

An order goes to the companions (component 191) that are heard: kill and lift to all of them, the others to one, which
takes them for both. With SYSTEM it goes to that vehicle's companion alone, kill excepted. It is said again until it is
answered, a kill five times a second; the answer is printed with the time it took, a refusal beside the companion's words.
"""

import time

from MAVProxy.modules.lib import mp_module

COMPANION = 191
# Of MAVProxy's own set of results, those that a companion answers with.
RESULTS = {
    0: "done",
    1: "cannot now",
    2: "REFUSES it",
    3: "does not know it",
    4: "has taken it, and it has NOT come about at both vehicles",
    5: "has it, not done yet",
}
IN_PROGRESS = 5
# Command, first parameter, said again after (s), so often at the most.
ORDERS = {
    "start": (300, 0, 1.0, 6),
    "pause": (193, 0, 1.0, 6),
    "continue": (193, 1, 1.0, 6),
    "return": (20, 0, 1.0, 6),
    "kill": (31011, 0, 0.2, 150),
    "lift": (31011, 1, 1.0, 6),
}
TO_ALL = ("kill", "lift")
# A companion that was silent for longer may be gone.
HEARD_S = 3.0
# What is under way is answered by then, a START's end included.
ANSWERED_WITHIN_S = 40.0


class Asked:
    """One order to one companion."""

    def __init__(self, order, system):
        self.order, self.system = order, system
        self.since, self.sent, self.next, self.under_way = time.time(), 0, 0.0, False

    def __str__(self):
        return "veilwing %s: companion %u" % (self.order, self.system)


class Veilwing(mp_module.MPModule):
    """See the module."""

    def __init__(self, mpstate):
        super(Veilwing, self).__init__(
            mpstate, "veilwing", "orders to veilwing's companions", multi_vehicle=True
        )
        self.heard, self.texts, self.asked = {}, {}, []
        self.add_command("veilwing", self.cmd_veilwing, "orders to both companions", [*ORDERS, "status"])

    def cmd_veilwing(self, args):
        """As it is typed."""
        if args[:1] == ["status"] and len(args) == 1:
            return self.status()
        if not args or args[0] not in ORDERS or len(args) > 2 or not all(a.isdigit() for a in args[1:]):
            print("usage: veilwing %s [SYSTEM], or veilwing status" % "|".join(ORDERS))
            return None
        return self.give(args[0], int(args[1]) if len(args) == 2 else None)

    def status(self):
        """Who is heard, and what it said last."""
        if not self.heard:
            print("veilwing: no companion (component %u) heard" % COMPANION)
        for system, at in sorted(self.heard.items()):
            said = self.texts.get(system, "")
            print("veilwing: companion %u heard %.1f s ago: %s" % (system, time.time() - at, said))

    def give(self, order, system):
        """Gives an order to whom it is for."""
        present = sorted(k for k, at in self.heard.items() if time.time() - at < HEARD_S)
        if order == "kill":
            # Whatever was chosen: it counts for both, and may reach one alone. Nobody heard may yet hear.
            systems = sorted(self.heard) or [0]
        elif system is not None:
            systems = [system]
        else:
            systems = present if order in TO_ALL else present[:1]
        if not systems:
            print("veilwing %s: NOT given: no companion (component %u) is heard" % (order, COMPANION))
            return
        self.asked = [a for a in self.asked if ORDERS[a.order][0] != ORDERS[order][0]]
        self.asked += [Asked(order, k) for k in systems]
        self.idle_task()

    def idle_task(self):
        """Says again what is not answered."""
        now = time.time()
        for asked in list(self.asked):
            command, param1, again_s, most = ORDERS[asked.order]
            late = now - asked.since > ANSWERED_WITHIN_S
            if late or not asked.under_way and asked.sent >= most and now >= asked.next:
                self.asked.remove(asked)
                print("%s: NO ANSWER in %.0f s, %u times sent" % (asked, now - asked.since, asked.sent))
            elif not asked.under_way and now >= asked.next:
                self.send(asked.system, command, param1, min(asked.sent, 255))
                asked.sent += 1
                asked.next = now + again_s

    def send(self, system, command, param1, confirmation):
        """On every link: a vehicle may be on any."""
        for master in self.mpstate.mav_master:
            master.mav.command_long_send(system, COMPANION, command, confirmation, param1, 0, 0, 0, 0, 0, 0)

    def mavlink_packet(self, m):
        """Who is heard, what it says, what it answers."""
        if m.get_srcComponent() != COMPANION:
            return
        system, kind = m.get_srcSystem(), m.get_type()
        self.heard[system] = time.time()
        if kind == "STATUSTEXT":
            self.texts[system] = m.text
        elif kind == "COMMAND_ACK":
            self.answered(system, m)

    def answered(self, system, m):
        """An answer to what was asked, if it is one."""
        for asked in list(self.asked):
            if ORDERS[asked.order][0] != m.command or asked.system not in (0, system):
                continue
            words = RESULTS.get(m.result, "answers %u" % m.result)
            print("%s: %s after %.2f s" % (asked, words, time.time() - asked.since))
            asked.under_way = True
            if m.result != IN_PROGRESS:
                self.asked.remove(asked)


def init(mpstate):
    """MAVProxy's entry."""
    return Veilwing(mpstate)
