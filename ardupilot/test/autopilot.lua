-- The part of ArduPilot's scripting interface that the bridge and its guard use, on a clock that the test turns.
local wire = require("wire")
local autopilot = {}

-- SCR_VM_I_COUNT as ArduPilot has it unless told otherwise.
autopilot.ALLOWANCE = 10000
local BRIDGE, GUARD = "ardupilot/veilwing.lua", "ardupilot/veilwing_guard.lua"

-- A 32-bit counter that wraps, as userdata in the firmware: only its difference is a number.
local uint32 = {}
uint32.__index = uint32
uint32.__sub = function(a, b)
   return setmetatable({ value = (a.value - b.value) & 0xFFFFFFFF }, uint32)
end
function uint32:toint()
   return self.value
end

-- VEILWING_RADIO in TUNNEL, by the message's definition; its checksum is that of the MAVLink documents, bit by bit.
function autopilot.report(payload)
   assert(#payload == 133, "the firmware reads TUNNEL's whole length")
   local kind, to_system, to_component, length = string.unpack("<I2BBB", payload)
   assert(kind == 42120 and to_system == 0 and to_component == 0)
   local frame = payload:sub(6, 5 + length)
   assert(#frame == 45 and payload:sub(6 + length):find("[^\0]") == nil)
   assert(string.unpack("<I2", frame:sub(-2)) == wire.crc(frame:sub(2, -3) .. "\49"), "checksum")
   local report, start, size, id = {}, string.unpack("<BB", frame)
   assert(start == 0xFD and size == 33)
   report.sequence, report.sysid, report.compid, id = string.unpack("<BBBI3", frame, 5)
   assert(report.sysid == 2 and report.compid == 1 and id == 42120)
   report.time_ms, report.boot, report.newest, report.answers_boot, report.answers, report.series, report.expires_ms, report.power_mdbm, report.result =
      string.unpack("<I4I4I4I4I4I4I4i4B", frame, 11)
   return report
end

-- Starts the script on a fresh autopilot. `change` may alter it before.
function autopilot.boot(change)
   local a = {
      now_ms = 0xFFFFFFFF - 20000, -- the counter wraps in the middle of the test
      mode = 4,
      armed = true,
      offsets = { 0, 0 },
      relay = false,
      pwm = 1000,
      override_until = nil,
      parameters = { FRAME_CLASS = 16, MAV_SYSID = 2, VW_TX_FN = 94, VW_TX_RELAY = 1 },
      queue = {},
      sent = {},
      reports = {},
      texts = {},
      blocked = {},
      broken = false,
      scripts = {},
      most = {}, -- instructions that a run of each script has taken at the most, where they are counted
   }
   a.allowance = autopilot.ALLOWANCE
   if change then
      change(a)
   end

   function millis()
      return setmetatable({ value = a.now_ms & 0xFFFFFFFF }, uint32)
   end
   function micros()
      return setmetatable({ value = (a.now_ms * 1000 + 7) & 0xFFFFFFFF }, uint32)
   end
   param = {}
   function param:get(name)
      return a.parameters[name]
   end
   function param:set(name, value)
      assert(a.parameters[name], name)
      a.parameters[name] = string.unpack("<f", string.pack("<f", value))
      return true
   end
   function param:add_table(key, prefix, count)
      a.table = { key = key, prefix = prefix, count = count }
      return true
   end
   function param:add_param(key, index, name, default)
      assert(key == a.table.key and index <= a.table.count and #(a.table.prefix .. name) <= 16)
      local full = a.table.prefix .. name
      a.parameters[full] = a.parameters[full] or default
      return true
   end
   gcs = {}
   function gcs:send_text(severity, text)
      assert(#text <= 50, "a STATUSTEXT holds 50 characters: " .. text)
      table.insert(a.texts, text)
   end
   arming = {}
   function arming:is_armed()
      return a.armed
   end
   vehicle = {}
   function vehicle:get_mode()
      return a.mode
   end
   attitude_control = {}
   function attitude_control:set_offset_roll_pitch(roll, pitch)
      assert(a.parameters.FRAME_CLASS == 16, "there is no 6DoF attitude controller on other frames")
      assert(not a.broken, "broken")
      a.offsets = { roll, pitch }
   end
   SRV_Channels = {}
   function SRV_Channels:find_channel(servo_function)
      return servo_function == 94 and 8 or nil
   end
   function SRV_Channels:set_output_pwm_chan_timeout(channel, pwm, timeout_ms)
      assert(channel == 8 and math.type(pwm) == "integer" and math.type(timeout_ms) == "integer")
      assert(timeout_ms >= 0 and timeout_ms <= 65535)
      a.pwm, a.override_until = pwm, timeout_ms > 0 and a.now_ms + timeout_ms or nil
   end
   function SRV_Channels:set_output_scaled(servo_function, value)
      assert(servo_function == 94 and value == 0)
   end
   relay = {}
   function relay:enabled(number)
      return number == 1
   end
   function relay:on(_)
      a.relay = true
   end
   function relay:off(_)
      a.relay = false
   end
   mavlink = {}
   function mavlink:init(depth, count)
      assert(depth <= 25 and count <= 25, "the firmware's limits")
      a.depth, a.kinds = depth, count
   end
   function mavlink:register_rx_msgid(_)
      return true
   end
   function mavlink:block_command(command)
      a.blocked[command] = true
      return true
   end
   function mavlink:receive_chan()
      local bytes = table.remove(a.queue, 1)
      if bytes then
         return bytes, 3, millis()
      end
   end
   function mavlink:send_chan(channel, msgid, payload)
      assert(channel == 3)
      if msgid == 385 then
         table.insert(a.reports, autopilot.report(payload))
         return true
      end
      table.insert(a.sent, { msgid = msgid, payload = payload })
      return true
   end

   -- Each script has globals of its own.
   local function load(name)
      local run = assert(loadfile(name, "t", setmetatable({}, { __index = _G })))
      a.scripts[name] = { run = run, next_at = a.now_ms }
   end

   -- One run of a script. With `a.counts`, its instructions are counted, the stand-in's excepted, and more than the
   -- allowance end it as in the firmware: an error at every further instruction, and it is never run again.
   local function run(name)
      local script, count = a.scripts[name], 0
      if a.counts then
         debug.sethook(function()
            if debug.getinfo(2, "S").short_src == name then
               count = count + 1
               if count > a.allowance then
                  error("Exceeded CPU time")
               end
            end
         end, "", 1)
      end
      local good, again, period = pcall(script.run)
      debug.sethook()
      a.most[name] = math.max(a.most[name] or 0, count)
      if good and count <= a.allowance then
         script.run, script.next_at = again, a.now_ms + period
      else
         a.scripts[name] = nil
         table.insert(a.texts, name .. (good and " exceeded time limit" or " failed: " .. tostring(again)))
      end
   end

   local names = a.without_guard and { BRIDGE } or { BRIDGE, GUARD }
   for _, name in ipairs(names) do
      load(name)
      run(name)
   end
   assert(a.scripts[BRIDGE], a.texts[#a.texts])

   function a.kill_bridge()
      a.scripts[BRIDGE] = nil
   end

   function a.bridge_lives()
      return a.scripts[BRIDGE] ~= nil
   end

   -- Takes a message off a link as the firmware does: the queue keeps the oldest.
   function a.receive(bytes)
      if #a.queue < a.depth then
         table.insert(a.queue, bytes)
      end
   end

   -- Passes time, with the scripts or without them (the engine itself has stopped).
   function a.pass(duration_ms, without_scripts)
      local to = a.now_ms + duration_ms
      while a.now_ms < to do
         a.now_ms = a.now_ms + 1
         if a.override_until and a.now_ms >= a.override_until then
            a.pwm, a.override_until = 1000, nil
         end
         for _, name in ipairs(without_scripts and {} or names) do
            if a.scripts[name] and a.now_ms >= a.scripts[name].next_at then
               run(name)
            end
         end
      end
   end

   -- Sends a command and returns the answer; nil if there is none.
   function a.command(name, command, fields, form)
      local message = { command = command, target_system = 2, target_component = 1 }
      for key, value in pairs(fields or {}) do
         message[key] = value
      end
      a.sent = {}
      a.receive(wire.pack(name, 1, 191, message, form))
      a.pass(11)
      assert(#a.sent <= 1, "one answer at most")
      if #a.sent == 0 then
         return nil
      end
      local result = {}
      result.command, result.result, result.progress, result.result_param2, result.system, result.component =
         string.unpack("<I2BBi4BB", a.sent[1].payload)
      assert(a.sent[1].msgid == 77 and #a.sent[1].payload == 10 and result.command == command)
      assert(result.system == 1 and result.component == 191)
      return result.result, result.result_param2
   end
   -- Sends a numbered command by what the radio said last, or as `fields` have it; returns its answer.
   function a.numbered(dbm, number, ahead_ms, fields)
      local last = a.reports[#a.reports] or { series = 0 }
      local message = { command = 31010, target_system = 2, target_component = 1, x = 7 }
      message.param1, message.param2, message.param3, message.param4 = dbm, number, 5, last.series
      local y = (a.now_ms + ahead_ms) & 0xFFFFFFFF
      message.y = y > 0x7FFFFFFF and y - 0x100000000 or y
      local sysid, compid = 2, 191
      for key, value in pairs(fields or {}) do
         message[key] = value
      end
      local before = #a.reports
      a.receive(wire.pack("COMMAND_INT", fields and fields.sysid or sysid, fields and fields.compid or compid, message))
      a.pass(11)
      for at = before + 1, #a.reports do
         if a.reports[at].answers ~= 0 then
            return a.reports[at]
         end
      end
      return nil
   end
   function a.offset(roll, pitch)
      return a.command("COMMAND_LONG", 31013, { param1 = roll, param2 = pitch })
   end
   function a.switch(value)
      return a.command("COMMAND_LONG", 31014, { param1 = value })
   end
   function a.lease(dbm, expiry_ms, slot)
      return a.command("COMMAND_INT", 31010, { param1 = dbm, x = slot or 7, y = expiry_ms })
   end
   -- Until the two scripts have seen each other.
   a.pass(250)
   return a
end

return autopilot
