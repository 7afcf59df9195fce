-- veilwing's bridge on ArduPilot: body offsets of a 6DoF frame, and the payload radio's power, by MAVLink commands.
--
--   31013  COMMAND_LONG  param1 roll, param2 pitch, degrees, aerospace signs: the attitude to hold while flying level
--   31014  COMMAND_LONG  param1 1: follow the offsets; 0: level
--   31010  COMMAND_INT   param1 power dBm (minus infinity: off), param2 number, param3 the companion's boot, param4 series,
--                        x slot, y when it is off by itself, on the clock that the answers state (ms); docs/radio.md.
--                        Without a number: y milliseconds from now (0 or less: off now)
--   31011  either        radio kill, until the autopilot restarts
--
-- Each is answered with COMMAND_ACK; the answer to 31010 carries the power achieved in thousandths of a dBm
-- (the least int32: off). A numbered 31010 is answered with VEILWING_RADIO in TUNNEL, and from then on that is said five
-- times a second. Offsets hold in GUIDED alone, and only while they are renewed; the radio is on in GUIDED and
-- armed alone, and never past its expiry. Beside it runs veilwing_guard.lua, which levels the vehicle and silences the
-- radio should this script be gone. README.md says how to install both and what each parameter means.

local PERIOD_MS = 10
local AFTER_FAULT_MS = 100
local GUIDED = 4
local FRAME_CLASS_6DOF = 16
local AUTOPILOT_COMPONENT = 1
local CMD = { LEASE = 31010, KILL = 31011, OFFSETS = 31013, SWITCH = 31014 }
local ACCEPTED, NOT_NOW, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
local SEVERITY = { CRITICAL = 2, ERROR = 3, NOTICE = 5, INFO = 6 }
local OFF_MDBM = -2147483648
local LONGEST_LEASE_MS = 5000
local RESTATE_OFF_MS = 1000
-- The next step may come this much later: what ends before it ends now.
local LATEST_STEP_MS = 15
local REPORT_MS = 200
local BEAT_MS = 50
local GUARD_GONE_MS = 500

-- Parameters ---------------------------------------------------------------------------------------------------------

local TABLE_KEY = 117
local PREFIX = "VW_"
local DEFAULTS = {
   { "TX_FN", 0 }, -- servo function of the power line, 94 (Script1) to 109; 0: none
   { "TX_RELAY", -1 }, -- relay that keys the radio, from 0; -1: none
   { "TX_OFF", 1000 }, -- PWM that silences the radio, microseconds
   { "TX_LO", 1100 }, -- PWM of the least power
   { "TX_HI", 1900 }, -- PWM of the greatest power
   { "DBM_LO", 0 }, -- the least power
   { "DBM_HI", 20 }, -- the greatest power; what the relay alone gives
   { "TILT_RATE", 45 }, -- fastest turn of the offsets, degrees per second
   { "OFS_MS", 1000 }, -- offsets not renewed for so long go back to level
   -- What the two scripts tell each other; not to be set.
   { "BEAT", 0 }, -- this script's pulse: changes while it runs
   { "GUARD", 0 }, -- the guard's pulse
   { "TX_END", -1 }, -- when the radio is off by itself, ms of the clock modulo 2^24; -1: it is off
   { "ROLL", 0 }, -- the offsets as they are, degrees
   { "PITCH", 0 },
}

assert(param:add_table(TABLE_KEY, PREFIX, #DEFAULTS), "veilwing: parameter table key is taken")
for index, entry in ipairs(DEFAULTS) do
   assert(param:add_param(TABLE_KEY, index, entry[1], entry[2]), "veilwing: cannot add " .. PREFIX .. entry[1])
end

local function setting(index)
   return param:get(PREFIX .. DEFAULTS[index][1]) or DEFAULTS[index][2]
end

local function share(name, value)
   param:set(PREFIX .. name, value)
end

local function say(severity, text)
   -- A STATUSTEXT holds 50 characters; of a fault the end says most.
   gcs:send_text(severity, "veilwing: " .. text:sub(-40))
end

-- Finite: neither NaN nor infinite.
local function finite(number)
   return number == number and number > -math.huge and number < math.huge
end

local function since_ms(instant)
   return (millis() - instant):toint()
end

local function in_guided()
   return arming:is_armed() and vehicle:get_mode() == GUIDED
end

-- The guard ----------------------------------------------------------------------------------------------------------

local guard = { beat = nil, heard_at = nil, beaten_at = millis() }

function guard.alive()
   return guard.heard_at ~= nil and since_ms(guard.heard_at) <= GUARD_GONE_MS
end

-- Shows this script's pulse and looks for the guard's.
function guard.update()
   if since_ms(guard.beaten_at) < BEAT_MS then
      return
   end
   guard.beaten_at = millis()
   -- Below 2^24: a parameter is of single precision.
   share("BEAT", guard.beaten_at:toint() & 0xFFFFF)
   local beat = setting(11)
   if guard.beat and beat ~= guard.beat then
      guard.heard_at = millis()
   elseif guard.heard_at and not guard.alive() then
      guard.heard_at = nil
      say(SEVERITY.ERROR, "the guard script is gone")
   end
   guard.beat = beat
end

-- Body offsets -------------------------------------------------------------------------------------------------------

local offsets = {
   supported = param:get("FRAME_CLASS") == FRAME_CLASS_6DOF,
   on = false,
   wanted = { 0, 0 },
   applied = { 0, 0 },
   renewed_at = nil,
   stepped_at = millis(),
}

function offsets.apply(roll, pitch)
   offsets.applied = { roll, pitch }
   share("ROLL", roll)
   share("PITCH", pitch)
   attitude_control:set_offset_roll_pitch(roll, pitch)
end

function offsets.level()
   offsets.wanted = { 0, 0 }
   offsets.renewed_at = nil
end

-- The way from here to there, no longer than a step: both angles together, so that the turn keeps its direction.
local function toward(from, to, step)
   local d1, d2 = to[1] - from[1], to[2] - from[2]
   local far = math.sqrt(d1 * d1 + d2 * d2)
   if far <= step then
      return to[1], to[2]
   end
   return from[1] + d1 * step / far, from[2] + d2 * step / far
end

function offsets.update()
   if not offsets.supported then
      return
   end
   local passed_ms = since_ms(offsets.stepped_at)
   offsets.stepped_at = millis()
   if offsets.on and not in_guided() then
      -- The pilot, or a failsafe, has the vehicle: it flies as it always does.
      offsets.on = false
      offsets.level()
      say(SEVERITY.NOTICE, "left GUIDED, going level")
   end
   if offsets.renewed_at and since_ms(offsets.renewed_at) > setting(9) then
      offsets.level()
      say(SEVERITY.NOTICE, "offsets not renewed, going level")
   end
   local goal = offsets.on and offsets.wanted or { 0, 0 }
   if goal[1] ~= offsets.applied[1] or goal[2] ~= offsets.applied[2] then
      local step = math.max(setting(8), 1) * passed_ms * 0.001
      offsets.apply(toward(offsets.applied, goal, step))
   end
end

function offsets.command(roll, pitch)
   if not offsets.supported then
      return UNSUPPORTED
   end
   if not (finite(roll) and finite(pitch)) or math.abs(roll) > 180 or math.abs(pitch) > 90 then
      return DENIED
   end
   local level = roll == 0 and pitch == 0
   if not level and not (offsets.on and in_guided()) then
      return NOT_NOW
   end
   offsets.wanted = { roll, pitch }
   offsets.renewed_at = (not level) and millis() or nil
   -- On the ground it is said in time that the guard is missing; what is asked is done all the same.
   return (guard.alive() or arming:is_armed()) and ACCEPTED or FAILED
end

function offsets.switch(value)
   if not offsets.supported then
      return UNSUPPORTED
   end
   if value == 1 then
      if not in_guided() then
         return NOT_NOW
      elseif not guard.alive() then
         return FAILED
      end
      offsets.on = true
   elseif value == 0 then
      offsets.on = false
      offsets.level()
   else
      return DENIED
   end
   return ACCEPTED
end

-- The radio ----------------------------------------------------------------------------------------------------------

local radio = { killed = false, until_off = nil, expires_in = 0, ends_early = 0, stated_at = nil, power_mdbm = OFF_MDBM }

local function power_line()
   local servo_function = setting(1)
   return servo_function > 0 and SRV_Channels:find_channel(servo_function) or nil
end

local function key_relay()
   local relay_number = setting(2)
   return relay_number >= 0 and relay:enabled(relay_number) and relay_number or nil
end

function radio.silence()
   radio.until_off = nil
   radio.power_mdbm = OFF_MDBM
   radio.stated_at = millis()
   share("TX_END", -1)
   local key, line = key_relay(), power_line()
   if key then
      relay:off(key)
   end
   if line then
      SRV_Channels:set_output_pwm_chan_timeout(line, math.floor(setting(3)), 0)
      SRV_Channels:set_output_scaled(math.floor(setting(1)), 0)
   end
end

-- The power that can be had without exceeding what is asked for, in dBm, and its PWM; nil if there is none.
local function achievable(dbm, line)
   local low, high = setting(6), setting(7)
   if not line then
      return dbm >= high - 0.005 and high or nil, nil
   end
   if dbm < low - 0.005 then
      return nil, nil
   end
   local pwm_low, pwm_high = setting(4), setting(5)
   local share = high > low and (math.min(dbm, high) - low) / (high - low) or 1
   -- Towards the lower power.
   local exact = pwm_low + math.max(share, 0) * (pwm_high - pwm_low)
   local pwm = pwm_high >= pwm_low and math.floor(exact + 1e-6) or math.ceil(exact - 1e-6)
   local reached = pwm_high ~= pwm_low and (pwm - pwm_low) / (pwm_high - pwm_low) or share
   return low + reached * (high - low), pwm
end

-- On for so long, or why not; then nothing changes.
function radio.radiate(dbm, expiry_ms, ends_early)
   if radio.killed or not finite(dbm) or expiry_ms > LONGEST_LEASE_MS then
      return DENIED
   end
   local key, line = key_relay(), power_line()
   local reached, pwm = achievable(dbm, line)
   if not reached then
      return DENIED
   end
   if not in_guided() then
      return NOT_NOW
   end
   if key and not guard.alive() then
      -- Nothing else opens the relay should this script be gone by then.
      return FAILED
   end
   share("TX_END", (millis():toint() + expiry_ms) & 0xFFFFFF)
   if line then
      -- The firmware ends this by itself, should the script be gone by then.
      SRV_Channels:set_output_pwm_chan_timeout(line, pwm, expiry_ms)
   end
   if key then
      relay:on(key)
   end
   radio.until_off = millis()
   radio.expires_in = expiry_ms
   radio.ends_early = ends_early
   radio.power_mdbm = math.floor(reached * 1000 + 0.5)
   return ACCEPTED
end

function radio.lease(dbm, expiry_ms)
   if not (key_relay() or power_line()) then
      return UNSUPPORTED, OFF_MDBM
   end
   local result = ACCEPTED
   if expiry_ms > 0 then
      result = radio.radiate(dbm, expiry_ms, 0)
   end
   if expiry_ms <= 0 or result ~= ACCEPTED then
      radio.silence()
   end
   return result, radio.power_mdbm
end

function radio.kill()
   radio.killed = true
   radio.silence()
   say(SEVERITY.CRITICAL, "radio killed until reboot")
   return (key_relay() or power_line()) and ACCEPTED or UNSUPPORTED, OFF_MDBM
end

function radio.update()
   if radio.until_off then
      local over = since_ms(radio.until_off) >= radio.expires_in - radio.ends_early
      if over or not in_guided() then
         radio.silence()
      end
   elseif not radio.stated_at or since_ms(radio.stated_at) >= RESTATE_OFF_MS then
      radio.silence()
   end
end

-- Numbered commands --------------------------------------------------------------------------------------------------

local RESULT = { ACCEPTED = 0, NOT_NEWER = 1, OTHER_SERIES = 2, EXPIRED = 3, DENIED = 4, NOT_NOW = 5, FAILED = 6 }
local RESULTS = { [ACCEPTED] = RESULT.ACCEPTED, [NOT_NOW] = RESULT.NOT_NOW, [DENIED] = RESULT.DENIED, [FAILED] = RESULT.FAILED }
local WHOLE = 1 << 24

math.randomseed(micros():toint())
local numbered = { boot = 0, newest = 0, series = math.random(1, WHOLE - 1), expires_ms = 0 }

local function clock_ms()
   return millis():toint() & 0xFFFFFFFF
end

-- How far ahead of the clock a time is, negative if it is behind: both wrap at 32 bits.
local function ahead_ms(time_ms)
   local ahead = (time_ms - clock_ms()) & 0xFFFFFFFF
   -- Where integers have 32 bits, as in the firmware, the sign is there already.
   return ahead > 0x7FFFFFFF and ahead - 0xFFFFFFFF - 1 or ahead
end

-- A whole number that came as a float; 0 for what is none.
local function whole(number)
   return finite(number) and number >= 0 and number < WHOLE and math.tointeger(number) or 0
end

function numbered.obey(message, boot, number)
   if boot == 0 or boot ~= numbered.boot then
      if boot == 0 or whole(message.param4) ~= numbered.series then
         return RESULT.OTHER_SERIES
      end
      -- The companion started anew: what was before it is over, and what of it is still under way is refused.
      numbered.boot, numbered.newest, numbered.series = boot, 0, math.random(1, WHOLE - 1)
      radio.silence()
   end
   if number <= numbered.newest then
      return RESULT.NOT_NEWER
   end
   numbered.newest = number
   if message.param1 == -math.huge then
      radio.silence()
      return RESULT.ACCEPTED
   end
   if not (key_relay() or power_line()) then
      return RESULT.FAILED
   end
   local left_ms = ahead_ms(message.y)
   if left_ms <= LATEST_STEP_MS then
      radio.silence()
      return RESULT.EXPIRED
   end
   local result = radio.radiate(message.param1, left_ms, LATEST_STEP_MS)
   if result == ACCEPTED then
      numbered.expires_ms = message.y & 0xFFFFFFFF
   end
   return RESULTS[result]
end

-- MAVLink ------------------------------------------------------------------------------------------------------------

local COMMAND_INT, COMMAND_LONG, COMMAND_ACK = 75, 76, 77
local CRC_EXTRA = { [COMMAND_INT] = 158, [COMMAND_LONG] = 152 }
-- The most that the firmware allows. When it is full, what comes is lost: see README.md.
local QUEUE = 25
-- The firmware removes for good a script that takes more than SCR_VM_I_COUNT (10000) instructions in one step. So many
-- messages are looked at in a step, and so many obeyed; the rest is for the next.
local LOOKS, OBEYS = 30, 2

mavlink:init(QUEUE, 2)
mavlink:register_rx_msgid(COMMAND_INT)
mavlink:register_rx_msgid(COMMAND_LONG)
local IS_OURS = {}
for _, command in pairs(CMD) do
   assert(mavlink:block_command(command), "veilwing: cannot take over command " .. command)
   IS_OURS[command] = true
end

local own_system = param:get("MAV_SYSID") or param:get("SYSID_THISMAV") or 1

-- VEILWING_RADIO (message_definitions/veilwing_radio.xml) as a whole frame in TUNNEL: the firmware sends no message that
-- it does not know.
local TUNNEL, TUNNEL_TYPE, TUNNEL_LENGTH = 385, 42120, 133
local RADIO_ID, RADIO_CRC_EXTRA, RADIO_LENGTH = 42120, 49, 33
local tunnel_sequence = 0

local function crc(bytes)
   local sum = 0xFFFF
   local values = { bytes:byte(1, -1) }
   for at = 1, #values do
      local t = values[at] ~ (sum & 0xFF)
      t = (t ~ (t << 4)) & 0xFF
      sum = ((sum >> 8) ~ (t << 8) ~ (t << 3) ~ (t >> 4)) & 0xFFFF
   end
   return sum
end

local function report(channel, answers_boot, answers, result)
   tunnel_sequence = (tunnel_sequence + 1) & 0xFF
   local body = string.pack(
      "<BBBBBBI3I4I4I4I4I4I4I4i4B",
      RADIO_LENGTH,
      0,
      0,
      tunnel_sequence,
      own_system,
      AUTOPILOT_COMPONENT,
      RADIO_ID,
      clock_ms(),
      numbered.boot,
      numbered.newest,
      answers_boot,
      answers,
      numbered.series,
      numbered.expires_ms,
      radio.power_mdbm,
      result
   )
   local frame = "\xFD" .. body .. string.pack("<I2", crc(body .. string.char(RADIO_CRC_EXTRA)))
   local payload = string.pack("<I2BBB", TUNNEL_TYPE, 0, 0, #frame) .. frame
   mavlink:send_chan(channel, TUNNEL, payload .. string.rep("\0", TUNNEL_LENGTH - #payload))
   numbered.reported_at = millis()
end

-- Takes a numbered command from the companion, the first that gave one since the start: nobody else is obeyed.
local function obey_numbered(message, channel)
   if message.sysid ~= own_system or message.compid ~= (numbered.commander or message.compid) then
      return
   end
   numbered.commander = message.compid
   numbered.channel = channel
   local boot, number = whole(message.param3), whole(message.param2)
   local result = numbered.obey(message, boot, number)
   report(channel, boot, number, result)
end

-- Result and result_param2 of a command.
local function obey(message)
   local is_int = message.msgid == COMMAND_INT
   if message.command == CMD.OFFSETS and not is_int then
      return offsets.command(message.param1, message.param2), 0
   elseif message.command == CMD.SWITCH and not is_int then
      return offsets.switch(message.param1), 0
   elseif message.command == CMD.LEASE and is_int and numbered.boot ~= 0 then
      -- Numbered commands are in use: one without a number is from nobody that counts.
      return DENIED, radio.power_mdbm
   elseif message.command == CMD.LEASE and is_int then
      return radio.lease(message.param1, message.y)
   elseif message.command == CMD.KILL then
      return radio.kill()
   end
   return UNSUPPORTED, 0
end

local function is_numbered(message)
   return message.command == CMD.LEASE and message.msgid == COMMAND_INT and message.param2 ~= 0
end

-- Whether a message is a command for this script, by the few bytes that say so: COMMAND_LONG and COMMAND_INT have them in
-- one place. The bytes are the firmware's mavlink_message_t: checksum, header, and the payload with zeros to its full length.
local function is_for_us(bytes)
   local command, system, component = string.unpack("<I2BB", bytes, 41)
   return IS_OURS[command] and system == own_system and component <= AUTOPILOT_COMPONENT
end

-- The command, or nil if it was damaged on its way: the firmware hands those on as well.
local function decode(bytes)
   local checksum, magic, length = string.unpack("<I2BB", bytes)
   local sysid, compid, msgid = string.unpack("<BBI3", bytes, 8)
   local extra = CRC_EXTRA[msgid]
   local header = magic == 0xFD and bytes:sub(4, 12) or bytes:sub(4, 4) .. bytes:sub(7, 10)
   if not extra or crc(header .. bytes:sub(13, 12 + length) .. string.char(extra)) ~= checksum then
      return nil
   end
   local message = { msgid = msgid, sysid = sysid, compid = compid, command = string.unpack("<I2", bytes, 41) }
   message.param1, message.param2, message.param3, message.param4, message.x, message.y =
      string.unpack("<ffffi4i4", bytes, 13)
   return message
end

local function handle(message, channel)
   if is_numbered(message) then
      return obey_numbered(message, channel)
   end
   local result, detail = obey(message)
   mavlink:send_chan(
      channel,
      COMMAND_ACK,
      string.pack("<I2BBi4BB", message.command, result, 0, detail, message.sysid, message.compid)
   )
end

local function receive()
   local obeyed = 0
   for _ = 1, LOOKS do
      local bytes, channel = mavlink:receive_chan()
      if not bytes then
         return
      end
      if is_for_us(bytes) then
         local message = decode(bytes)
         if message then
            handle(message, channel)
         end
         obeyed = obeyed + 1
         if obeyed == OBEYS then
            return
         end
      end
   end
end

local function step()
   guard.update()
   radio.update()
   receive()
   offsets.update()
   if numbered.channel and since_ms(numbered.reported_at) >= REPORT_MS then
      report(numbered.channel, 0, 0, RESULT.ACCEPTED)
   end
end

local told_at

local function update()
   local good, fault = pcall(step)
   if not good then
      pcall(radio.silence)
      offsets.on = false
      offsets.level()
      pcall(offsets.update)
      if not told_at or since_ms(told_at) >= 1000 then
         told_at = millis()
         say(SEVERITY.ERROR, tostring(fault))
      end
      return update, AFTER_FAULT_MS
   end
   return update, PERIOD_MS
end

radio.silence()
if offsets.supported then
   offsets.apply(0, 0)
end
say(SEVERITY.INFO, offsets.supported and "bridge ready" or "radio only, not a 6DoF frame")
return update()
