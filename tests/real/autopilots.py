"""The autopilots that pair.py flies: how each is started, what it calls things. Vehicle I is system 1, vehicle J system 2.

Ports, by instance k (0 for I): the ground station hears 14550, the companion 14540 + k, the payload radio 14030 + k. PORTS in the
environment (a number added to all, in hundreds) lets two pairs fly at once; PX4 keeps to its own, so with PX4 it is 0.
"""

import os
import shutil
import struct
import sys

import geo

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
PORTS = int(os.environ.get("PORTS", "0"))
ONBOARD, PAYLOAD, GROUND, PAIR, GATE_CONTROL = (PORTS + port for port in (14540, 14030, 14550, 14601, 4800))


class Px4:
    """PX4's own eight-rotor omnicopter (airframe 10019) in omni_hil.py."""

    firmware, actuation = "px4", "thrust_vector"
    vehicle = "omnidirectional", dict(max_tilt_deg=90.0, speed_m_s=8.0, climb_m_s=4.0, acceleration_m_s2=2.5, tilt_rate_deg_s=45.0)
    streams = ()
    # What the pilot asks for: main and sub mode.
    modes = dict(position=(3, 0), hold=(4, 3), land=(4, 6), home=(4, 5))
    main = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 10: "TERMINATION"}
    auto = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW", 9: "PRECLAND"}

    def __init__(self, role, folder):
        self.role, self.folder, self.k = role, folder, "ij".index(role)
        self.system = self.k + 1

    def start(self, spawn, home, options):
        tree = os.environ["PX4"] + "/build/px4_sitl_default"
        simulator = [
            sys.executable, HERE + "/px4/omni_hil.py", "--instance", self.k, "--csv", self.folder + "/truth.csv",
            "--lat", repr(home[0]), "--lon", repr(home[1]), "--alt", repr(home[2]), "--yaw", options.yaw,
            "--noise", options.noise, "--gust", options.gust, "--gyro-noise", options.gyro_noise,
            "--ground-shake", options.ground_shake, "--seed", self.system, "--wind", *options.wind,
        ]  # fmt: skip
        spawn("sim-" + self.role, simulator, self.folder + "/sim.log")
        environment = dict(
            os.environ, PX4_SYS_AUTOSTART="10019", PX4_SIM_MODEL="gazebo-classic_omnicopter", PX4_SIMULATOR="mavlink"
        )
        # PX4 sources px4-rc.params from where PATH finds it first.
        environment["PATH"] = HERE + "/px4/params:" + environment["PATH"]
        rootfs = self.folder + "/px4"
        os.makedirs(rootfs, exist_ok=True)
        program = [tree + "/bin/px4", "-i", self.k, "-d", tree + "/etc"]
        spawn("autopilot-" + self.role, program, self.folder + "/autopilot.log", rootfs, environment)

    def mode_name(self, custom):
        main, sub = (custom >> 16) & 0xFF, (custom >> 24) & 0xFF
        return self.main.get(main, str(main)) + ("." + self.auto.get(sub, str(sub)) if main == 4 else "")

    def gps_off(self, ground):
        ground.set(self, "SYS_FAILURE_EN", 1)
        ground.command(self.system, 1, 420, 4, 1)

    @staticmethod
    def decoded(message):
        """PX4 puts the bytes of an integer where the float is."""
        if message.param_type == 6:
            return struct.unpack("<i", struct.pack("<f", message.param_value))[0]
        return message.param_value

    @staticmethod
    def encoded(value, as_integer):
        return struct.unpack("<f", struct.pack("<i", int(value)))[0] if as_integer else float(value)


class Sih(Px4):
    """PX4's own quad in its own simulator (airframe 10040), stock; it tells its true state itself."""

    actuation = "position"
    # MPC_Z_VEL_MAX_DN is 1.5 m/s.
    vehicle = "conventional", dict(max_tilt_deg=90.0, speed_m_s=8.0, climb_m_s=1.5, acceleration_m_s2=1.5, tilt_rate_deg_s=45.0)
    streams = ((115, 50), (2, 10), (245, 2))

    def start(self, spawn, home, options):
        tree = os.environ["PX4"] + "/build/px4_sitl_default"
        environment = dict(os.environ, PX4_SYS_AUTOSTART="10040", PX4_SIM_MODEL="sihsim_quadx", PX4_SIMULATOR="sihsim")
        environment |= dict(zip(("PX4_HOME_LAT", "PX4_HOME_LON", "PX4_HOME_ALT"), map(repr, home)))
        rootfs = self.folder + "/px4"
        os.makedirs(rootfs, exist_ok=True)
        spawn("autopilot-" + self.role, [tree + "/bin/px4", "-i", self.k, "-d", tree + "/etc"], self.folder + "/autopilot.log", rootfs, environment)


class ArduCopter:
    """ArduCopter's own simulated quad."""

    firmware, actuation = "ardupilot", "position"
    vehicle = "conventional", dict(max_tilt_deg=90.0, speed_m_s=8.0, climb_m_s=4.0, acceleration_m_s2=1.5, tilt_rate_deg_s=45.0)
    # Message and Hz: the true state, and what is wanted for the record.
    streams = ((108, 50), (2, 10), (245, 2), (36, 200))
    modes = dict(position=(5,), hold=(5,), land=(9,), home=(6,))
    names = {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 17: "BRAKE"}
    model, parameters = "quad", ()

    def __init__(self, role, folder):
        self.role, self.folder, self.k = role, folder, "ij".index(role)
        self.system = self.k + 1

    def start(self, spawn, home, options):
        tree = os.environ["ARDUPILOT"]
        cwd = self.folder + "/sitl"
        os.makedirs(cwd, exist_ok=True)
        self.furnish(cwd)
        defaults = [tree + "/Tools/autotest/default_params/copter.parm", *self.parameters]
        program = [
            tree + "/build/sitl/bin/arducopter", "-w", f"-I{self.k + PORTS // 100}", "--sysid", self.system, "--model", self.model,
            "--speedup", 1, "--home=%.7f,%.7f,%.2f,%d" % (*home, 90 - options.yaw), "--defaults", ",".join(defaults),
            "--serial0", f"udpclient:127.0.0.1:{GROUND}", "--serial1", f"udpclient:127.0.0.1:{ONBOARD + self.k}",
            "--serial2", f"udpclient:127.0.0.1:{PAYLOAD + self.k}",
        ]  # fmt: skip
        spawn("autopilot-" + self.role, program, self.folder + "/autopilot.log", cwd)

    def furnish(self, cwd):
        """What the frame needs beside the program."""

    def mode_name(self, custom):
        return self.names.get(custom, str(custom))

    def gps_off(self, ground):
        ground.set(self, "SIM_GPS1_ENABLE", 0)

    @staticmethod
    def decoded(message):
        return message.param_value

    @staticmethod
    def encoded(value, as_integer):
        return float(value)


class Six(ArduCopter):
    """A canted hexa on ArduPilot's 6DoF frame, tilted by this project's bridge script."""

    actuation = "pose"
    vehicle = "omnidirectional", dict(max_tilt_deg=12.0, speed_m_s=2.5, climb_m_s=1.5, acceleration_m_s2=0.5, tilt_rate_deg_s=15.0)
    model, parameters = "hexa:canted.json", (HERE + "/six/six.parm",)

    def furnish(self, cwd):
        shutil.copy(HERE + "/six/canted.json", cwd)
        os.makedirs(cwd + "/scripts", exist_ok=True)
        for script in (HERE + "/six/motors6.lua", ROOT + "/ardupilot/veilwing.lua", ROOT + "/ardupilot/veilwing_guard.lua"):
            shutil.copy(script, cwd + "/scripts")


FRAMES = dict(px4=Px4, sih=Sih, quad=ArduCopter, six=Six)


class Truth:
    """The true states of a vehicle that tells them (SIM_STATE, HIL_STATE_QUATERNION) as truth.csv; omni_hil.py writes its own."""

    def __init__(self, folder):
        self.file = open(folder + "/truth.csv", "w", buffering=1)
        self.file.write("wall,t,lat,lon,alt,vx,vy,vz,qw,qx,qy,qz,armed,c0\n")
        self.boot_s = 0.0

    def put(self, wall, m, armed):
        if m.get_type() == "HIL_STATE_QUATERNION":
            place = m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3
            motion = m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2, *m.attitude_quaternion
        else:
            lat = m.lat_int * 1e-7 if m.lat_int else m.lat
            lon = m.lon_int * 1e-7 if m.lon_int else m.lon
            place, motion = (lat, lon, m.alt), (m.vn, m.ve, m.vd, m.q1, m.q2, m.q3, m.q4)
        row = (wall, self.boot_s, *place, *motion, int(armed), 0)
        self.file.write(",".join(f"{x:.9g}" if k not in (0, 2, 3) else f"{x:.9f}" for k, x in enumerate(row)) + "\n")


class PowerLine:
    """The radio as the bridge script drives it: SERVO9's pulse, written as radio.py writes its log. It is looked at 200 times a second:
    `last` is when it was seen on for the last time."""

    def __init__(self, path, note, dbm):
        self.dbm = dbm
        self.note, self.file, self.on_us, self.slot, self.off_at = note, open(path, "a", buffering=1), None, None, 0.0
        self.seen_on = 0.0

    def put(self, wall, pulse_us):
        self.seen_on = wall if pulse_us > 1005 else self.seen_on
        if pulse_us > 1005 and (self.on_us is None or abs(pulse_us - self.on_us) > 1):
            if self.slot is None:
                self.slot = 0
            elif self.on_us is None and wall - self.off_at > 3.0:
                self.slot += 1
            self.on_us = pulse_us
            self.file.write(self.note(t=wall, on=True, dbm=round((pulse_us - 1100) / 800 * (self.dbm[1] - self.dbm[0]) + self.dbm[0], 2), slot=self.slot))
        elif pulse_us <= 1005 and self.on_us is not None:
            self.on_us, self.off_at = None, wall
            self.file.write(self.note(t=wall, on=False, why="pulse", last=self.seen_on))


def home_of(role, options):
    return [float(x) for x in geo.from_enu(options.home_i if role == "i" else options.home_j, options.origin)]
