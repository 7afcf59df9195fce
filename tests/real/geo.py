"""WGS 84 tangent plane, and omni_hil's own flat earth, for scoring. Written apart from the project."""

import math
import numpy as np

A_, F_ = 6378137.0, 1 / 298.257223563
E2 = F_ * (2 - F_)
R_E = 6371000.0


def ecef(lat, lon, h):
    la, lo = np.radians(lat), np.radians(lon)
    n = A_ / np.sqrt(1 - E2 * np.sin(la) ** 2)
    return np.stack(
        [(n + h) * np.cos(la) * np.cos(lo), (n + h) * np.cos(la) * np.sin(lo), (n * (1 - E2) + h) * np.sin(la)], -1
    )


def rot(lat, lon):
    la, lo = math.radians(lat), math.radians(lon)
    return np.array(
        [
            [-math.sin(lo), math.cos(lo), 0],
            [-math.sin(la) * math.cos(lo), -math.sin(la) * math.sin(lo), math.cos(la)],
            [math.cos(la) * math.cos(lo), math.cos(la) * math.sin(lo), math.sin(la)],
        ]
    )


def to_enu(lat, lon, h, o):
    return (
        ecef(np.asarray(lat, float), np.asarray(lon, float), np.asarray(h, float)) - ecef(*map(np.float64, o))
    ) @ rot(o[0], o[1]).T


def from_enu(e, o):
    """lat, lon, h by Newton on to_enu."""
    lat, lon, h = o
    for _ in range(5):
        d = np.asarray(e, float) - to_enu(lat, lon, h, o)
        lat += math.degrees(d[1] / 6367000.0)
        lon += math.degrees(d[0] / (6378137.0 * math.cos(math.radians(lat))))
        h += d[2]
    return lat, lon, h


def hil_to_enu(p_ned, start, o):
    """omni_hil's NED about its start (lat, lon, alt) -> ENU about o."""
    lat = start[0] + np.degrees(p_ned[:, 0] / R_E)
    lon = start[1] + np.degrees(p_ned[:, 1] / (R_E * math.cos(math.radians(start[0]))))
    return to_enu(lat, lon, start[2] - p_ned[:, 2], o)
