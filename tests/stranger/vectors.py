"""Prints the frames that tests/link/common.rs holds, as pymavlink makes them: pip install pymavlink==2.4.50"""
import os

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2

KEY = bytes(range(1, 33))
UNIX_S = 1_790_000_000
TIMESTAMP = (UNIX_S - 1_420_070_400) * 100_000


def sender(dialect, system, component, sequence=0, link_id=None):
    mav = dialect.MAVLink(None, system, component)
    mav.seq = sequence
    if link_id is not None:
        mav.signing.secret_key = KEY
        mav.signing.link_id = link_id
        mav.signing.timestamp = TIMESTAMP
        mav.signing.sign_outgoing = True
    return mav


def show(name, mav, message):
    print(name, message.pack(mav).hex())


def heartbeat(mav, vehicle=2, autopilot=12, status=4):
    return mav.heartbeat_encode(vehicle, autopilot, 81, 0x04030201, status, 3)


for name, mav in [
    ("HEARTBEAT_V1", sender(v1, 1, 1, 7)),
    ("HEARTBEAT_V2", sender(v2, 1, 1, 7)),
    ("HEARTBEAT_SIGNED", sender(v2, 1, 1, 7, link_id=5)),
]:
    show(name, mav, heartbeat(mav))
mav = sender(v2, 1, 1, 7)
show("HEARTBEAT_UNKNOWN", mav, heartbeat(mav, 250, 251, 252))
mav = sender(v2, 1, 1, 7)
show("COMMAND_ACK_UNKNOWN", mav, mav.command_ack_encode(400, 77))
mav = sender(v2, 1, 1)
show("STATUSTEXT_HELLO", mav, mav.statustext_encode(6, b"hello"))
mav = sender(v1, 51, 68)
show("RADIO_STATUS_V1", mav, mav.radio_status_encode(150, 140, 90, 30, 35, 2, 1))
mav = sender(v1, 1, 1)
show("SCALED_IMU2_V1", mav, mav.scaled_imu2_encode(*range(1, 11)))
mav = sender(v2, 1, 1)
show("SCALED_IMU2_V2", mav, mav.scaled_imu2_encode(*range(1, 11), 2500))
mav = sender(v2, 42, 191, 255, link_id=0)
show("PARAM_VALUE_SIGNED", mav, mav.param_value_encode(b"COM_OF_LOSS_T", 1.0, 9, 0, 1))
