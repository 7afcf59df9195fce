-- The dead-man of veilwing.lua: a script of its own, since ArduPilot removes a script that takes too many instructions or
-- fails, for good, and leaves its body offsets and its relay as they are.
--
-- Levels the vehicle at VW_TILT_RATE once the bridge's pulse (VW_BEAT) has stopped, and silences the radio at the end that
-- the bridge has stated for it (VW_TX_END), or when the vehicle leaves GUIDED or disarms: not before, as the other
-- vehicle may rely on it until then. It takes no messages, so nobody can keep it busy. README.md says how to install it.

local PERIOD_MS = 10
-- Runs of this script without a pulse, which comes every 50 ms: runs, as both wait while another script is slow.
local PULSELESS_RUNS = 30
local BEAT_RUNS = 10
-- The next run may come this much later: what ends before it ends now.
local LATEST_STEP_MS = 5
local GUIDED = 4
local FRAME_CLASS_6DOF = 16
local CRITICAL = 2

local is_6dof = param:get("FRAME_CLASS") == FRAME_CLASS_6DOF
local runs = 0
local bridge = { beat = nil, pulseless = 0, dead = false }
-- Where the offsets are on their way to level, degrees; nil while the bridge lives.
local offsets

local function say(text)
   gcs:send_text(CRITICAL, "veilwing: " .. text)
end

-- Looks for the bridge's pulse; before it was there once there is nothing to guard.
local function look()
   local beat = param:get("VW_BEAT")
   if beat ~= bridge.beat then
      bridge.beat, bridge.pulseless, bridge.dead = beat, 0, false
   elseif beat then
      bridge.pulseless = bridge.pulseless + 1
   end
   if bridge.pulseless >= PULSELESS_RUNS and not bridge.dead then
      bridge.dead = true
      offsets = { param:get("VW_ROLL") or 0, param:get("VW_PITCH") or 0 }
      say(is_6dof and "bridge is dead, going level" or "bridge is dead")
   end
end

local function level()
   local roll, pitch = offsets[1], offsets[2]
   local far = math.sqrt(roll * roll + pitch * pitch)
   local step = math.max(param:get("VW_TILT_RATE") or 0, 1) * PERIOD_MS * 0.001
   local left = far > step and 1 - step / far or 0
   -- Again and again, once level too: nothing else holds it there.
   offsets = { roll * left, pitch * left }
   attitude_control:set_offset_roll_pitch(offsets[1], offsets[2])
end

local function radio_is_over(ends)
   if not (arming:is_armed() and vehicle:get_mode() == GUIDED) then
      return true
   end
   local ahead = (math.floor(ends) - (millis():toint() & 0xFFFFFF)) & 0xFFFFFF
   return ahead <= LATEST_STEP_MS or ahead > 0x7FFFFF
end

local function silence()
   local key, servo_function = param:get("VW_TX_RELAY") or -1, param:get("VW_TX_FN") or 0
   local line = servo_function > 0 and SRV_Channels:find_channel(servo_function)
   if key >= 0 and relay:enabled(key) then
      relay:off(key)
   end
   if line then
      SRV_Channels:set_output_pwm_chan_timeout(line, math.floor(param:get("VW_TX_OFF") or 1000), 0)
      SRV_Channels:set_output_scaled(math.floor(servo_function), 0)
   end
   param:set("VW_TX_END", -1)
end

local function step()
   runs = runs + 1
   if runs % BEAT_RUNS == 0 then
      param:set("VW_GUARD", runs & 0xFFFFF)
   end
   look()
   local ends = param:get("VW_TX_END") or -1
   if ends >= 0 and radio_is_over(ends) then
      silence()
   end
   if bridge.dead and is_6dof then
      level()
   end
end

local function update()
   local good, fault = pcall(step)
   if not good and runs % 100 == 0 then
      say(tostring(fault):sub(-40))
   end
   return update, PERIOD_MS
end

return update()
