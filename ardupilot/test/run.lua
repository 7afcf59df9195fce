-- The bridge against a stand-in for ArduPilot: lua5.3 ardupilot/test/run.lua, from the root of the repository.
package.path = "ardupilot/test/?.lua;" .. package.path
local autopilot = require("autopilot")
local wire = require("wire")

local ACCEPTED, NOT_NOW, DENIED, UNSUPPORTED = 0, 1, 2, 3
local OFF = -2147483648
local passed = 0

local function equal(found, wanted, what)
   if found ~= wanted then
      error(string.format("%s: %s, should be %s", what, tostring(found), tostring(wanted)), 2)
   end
end

local function near(found, wanted, tolerance, what)
   if math.abs(found - wanted) > tolerance then
      error(string.format("%s: %s, should be %s within %s", what, found, wanted, tolerance), 2)
   end
end

local function test(name, body)
   local good, fault = xpcall(body, debug.traceback)
   if not good then
      print("FAILED " .. name .. "\n" .. fault)
      os.exit(1)
   end
   passed = passed + 1
   print("ok " .. name)
end

-- Keeps offsets renewed at 20 Hz.
local function hold(a, roll, pitch, duration_ms)
   for _ = 1, duration_ms // 50 do
      equal(a.offset(roll, pitch), ACCEPTED, "offset")
      a.pass(39)
   end
end

test("every command is taken over from the autopilot", function()
   local a = autopilot.boot()
   for _, command in ipairs({ 31010, 31011, 31013, 31014 }) do
      equal(a.blocked[command], true, command)
   end
end)

test("offsets are followed at the tilt rate, both angles together", function()
   local a = autopilot.boot()
   equal(a.switch(1), ACCEPTED, "switch")
   hold(a, 60, -30, 500)
   near(math.sqrt(a.offsets[1] ^ 2 + a.offsets[2] ^ 2), 0.5 * 45, 1.5, "turned in half a second")
   near(a.offsets[2] / a.offsets[1], -0.5, 1e-6, "direction")
   hold(a, 60, -30, 1500)
   equal(a.offsets[1], 60, "roll")
   equal(a.offsets[2], -30, "pitch")
end)

test("no offset before it is switched on, out of range, or not a number", function()
   local a = autopilot.boot()
   equal(a.offset(0, 0), ACCEPTED, "a probe")
   equal(a.offset(10, 0), NOT_NOW, "switched off")
   equal(a.switch(1), ACCEPTED, "switch")
   for _, bad in ipairs({ { 181, 0 }, { 0, 91 }, { 0 / 0, 0 }, { 0, math.huge } }) do
      equal(a.offset(bad[1], bad[2]), DENIED, "range")
   end
   equal(a.switch(0.5), DENIED, "neither on nor off")
   a.pass(500)
   equal(a.offsets[1], 0, "roll")
end)

test("leaving GUIDED levels the vehicle, and only the companion's switch brings offsets back", function()
   for _, leave in ipairs({
      function(a)
         a.mode = 5
      end,
      function(a)
         a.armed = false
      end,
   }) do
      local a = autopilot.boot()
      equal(a.switch(1), ACCEPTED, "switch")
      hold(a, 30, 0, 1000)
      equal(a.offsets[1], 30, "roll")
      leave(a)
      a.pass(1000)
      equal(a.offsets[1], 0, "level")
      a.mode, a.armed = 4, true
      equal(a.offset(30, 0), NOT_NOW, "back in GUIDED")
      a.pass(1000)
      equal(a.offsets[1], 0, "still level")
      equal(a.switch(1), ACCEPTED, "switch")
      hold(a, 30, 0, 1000)
      equal(a.offsets[1], 30, "followed again")
   end
end)

test("offsets that are not renewed go back to level, gently", function()
   local a = autopilot.boot()
   a.switch(1)
   hold(a, 45, 0, 2000)
   a.pass(970)
   near(a.offsets[1], 45, 1.5, "begins to level after a second")
   a.pass(500)
   near(a.offsets[1], 22.5, 2, "at the tilt rate")
   a.pass(600)
   equal(a.offsets[1], 0, "level")
end)

test("switching off levels", function()
   local a = autopilot.boot()
   a.switch(1)
   hold(a, 20, 20, 1500)
   equal(a.switch(0), ACCEPTED, "switch")
   a.pass(1000)
   equal(a.offsets[1], 0, "roll")
   equal(a.offsets[2], 0, "pitch")
end)

test("on other frames there are no offsets, and the radio works", function()
   local a = autopilot.boot(function(a)
      a.parameters.FRAME_CLASS = 1
   end)
   equal(a.offset(0, 0), UNSUPPORTED, "offset")
   equal(a.switch(1), UNSUPPORTED, "switch")
   equal((a.lease(20, 500)), ACCEPTED, "lease")
end)

test("a lease is on at its power, and off at its expiry without another word", function()
   local a = autopilot.boot()
   local result, achieved = a.lease(10, 500)
   equal(result, ACCEPTED, "lease")
   equal(achieved, 10000, "achieved")
   equal(a.pwm, 1500, "PWM")
   equal(a.relay, true, "relay")
   a.pass(480)
   equal(a.relay, true, "still on")
   a.pass(25)
   equal(a.relay, false, "expired")
   equal(a.pwm, 1000, "expired")
end)

test("a renewal lengthens, never adds up, and the millisecond counter may wrap", function()
   local a = autopilot.boot()
   for _ = 1, 300 do -- 30 s over the wrap at 20 s
      equal((a.lease(20, 200)), ACCEPTED, "renewal")
      equal(a.relay, true, "on")
      a.pass(89)
   end
   a.pass(115)
   equal(a.relay, false, "off")
end)

test("the power line falls silent by the firmware's own hand if the script is gone", function()
   local a = autopilot.boot()
   a.lease(20, 300)
   equal(a.pwm, 1900, "PWM")
   a.pass(301, true)
   equal(a.pwm, 1000, "PWM")
end)

test("off is off at once, and says so", function()
   local a = autopilot.boot()
   a.lease(20, 500)
   for _, expiry in ipairs({ 0, -1 }) do
      local result, achieved = a.lease(20, expiry)
      equal(result, ACCEPTED, "off")
      equal(achieved, OFF, "achieved")
      equal(a.relay, false, "relay")
      equal(a.pwm, 1000, "PWM")
   end
end)

test("never more power than asked for", function()
   local a = autopilot.boot()
   for tenth = 0, 250 do
      local dbm = tenth / 10
      local result, achieved = a.lease(dbm, 500)
      equal(result, ACCEPTED, "lease")
      assert(achieved <= dbm * 1000 + 6 and achieved <= 20000, dbm .. " gave " .. achieved)
      assert(achieved >= math.min(dbm, 20) * 1000 - 30, dbm .. " gave " .. achieved)
   end
   equal((a.lease(-1, 500)), DENIED, "below the least power")
   equal(a.relay, false, "relay")
   local keyed = autopilot.boot(function(a)
      a.parameters.VW_TX_FN = 0
   end)
   equal((keyed.lease(19, 500)), DENIED, "a relay alone gives 20 dBm")
   local result, achieved = keyed.lease(20, 500)
   equal(result, ACCEPTED, "lease")
   equal(achieved, 20000, "achieved")
   equal(keyed.relay, true, "relay")
end)

test("a line that is driven the other way round", function()
   local a = autopilot.boot(function(a)
      a.parameters.VW_TX_LO, a.parameters.VW_TX_HI = 1900, 1100
   end)
   local _, achieved = a.lease(7.77, 500)
   assert(achieved <= 7770 and achieved > 7740, achieved)
end)

test("what is not finite, too long, on the ground or in another mode does not radiate", function()
   local a = autopilot.boot()
   equal((a.lease(0 / 0, 500)), DENIED, "not a number")
   equal((a.lease(20, 5001)), DENIED, "too long")
   a.armed = false
   equal((a.lease(20, 500)), NOT_NOW, "disarmed")
   a.armed, a.mode = true, 5
   equal((a.lease(20, 500)), NOT_NOW, "LOITER")
   equal(a.relay, false, "relay")
   equal(a.pwm, 1000, "PWM")
end)

test("the pilot's mode silences the radio at once", function()
   local a = autopilot.boot()
   a.lease(20, 500)
   a.mode = 5
   a.pass(11)
   equal(a.relay, false, "relay")
   equal(a.pwm, 1000, "PWM")
end)

test("a radio kill lasts until the autopilot restarts", function()
   for _, form in ipairs({ "COMMAND_LONG", "COMMAND_INT" }) do
      local a = autopilot.boot()
      a.lease(20, 500)
      equal((a.command(form, 31011)), ACCEPTED, "kill")
      equal(a.relay, false, "relay")
      equal((a.lease(20, 500)), DENIED, "lease")
      equal((a.lease(20, 0)), ACCEPTED, "off")
      a.pass(60000)
      equal((a.lease(20, 500)), DENIED, "a minute later")
      equal((autopilot.boot().lease(20, 500)), ACCEPTED, "after a restart")
   end
end)

local NOT_NEWER, OTHER_SERIES, EXPIRED, RADIO_DENIED, RADIO_NOT_NOW = 1, 2, 3, 4, 5
local SILENT = -math.huge

-- A radio that has taken this companion's boot.
local function taken(change)
   local a = autopilot.boot(change)
   equal(a.numbered(SILENT, 1, 0).result, OTHER_SERIES, "the series is not known yet")
   local answer = a.numbered(SILENT, 2, 0)
   equal(answer.result, ACCEPTED, "taken")
   equal(answer.boot, 5, "boot")
   return a
end

test("a numbered power ends by the stated clock, never late", function()
   local a = taken()
   local sent_at = a.now_ms
   local answer = a.numbered(10, 3, 500)
   equal(answer.result, ACCEPTED, "on")
   equal(answer.answers_boot, 5, "boot")
   equal(answer.answers, 3, "number")
   equal(answer.newest, 3, "newest")
   equal(answer.power_mdbm, 10000, "achieved")
   equal(answer.expires_ms, (sent_at + 500) & 0xFFFFFFFF, "expiry")
   equal(a.relay, true, "relay")
   a.pass(sent_at + 500 - 26 - a.now_ms)
   equal(a.relay, true, "still on")
   equal(a.pwm, 1500, "PWM")
   a.pass(sent_at + 500 - a.now_ms)
   equal(a.relay, false, "relay")
   equal(a.pwm, 1000, "PWM")
end)

test("a command that comes late is on for less, or not at all", function()
   local a = taken()
   equal(a.numbered(20, 3, 500, { y = nil }).result, ACCEPTED, "on")
   -- Sent 400 ms ago.
   local answer = a.numbered(20, 4, 100)
   equal(answer.result, ACCEPTED, "on")
   a.pass(90)
   equal(a.relay, false, "off in time")
   answer = a.numbered(20, 5, -100)
   equal(answer.result, EXPIRED, "too late")
   equal(answer.newest, 5, "its number is taken")
   equal(a.relay, false, "relay")
end)

test("what is not newer, of a dead boot or of somebody else changes nothing", function()
   local a = taken()
   equal(a.numbered(20, 10, 4000).result, ACCEPTED, "on")
   for _, number in ipairs({ 10, 9, 0.5, -1, 0 / 0 }) do
      local answer = a.numbered(SILENT, number, 0)
      equal(answer == nil or answer.result == NOT_NEWER, true, "number " .. number)
   end
   equal(a.numbered(SILENT, 11, 0, { compid = 190 }), nil, "another component")
   equal(a.numbered(SILENT, 11, 0, { sysid = 255 }), nil, "another system")
   equal((a.lease(20, 0)), DENIED, "without a number")
   equal(a.relay, true, "still on")
   -- The companion starts anew: it is off, and what the dead one had under way is refused.
   local old = a.reports[#a.reports].series
   local answer = a.numbered(SILENT, 1, 0, { param3 = 6 })
   equal(answer.result, ACCEPTED, "taken")
   equal(answer.boot, 6, "boot")
   equal(a.relay, false, "off")
   assert(answer.series ~= old, "another series")
   equal(a.numbered(20, 12, 500, { param4 = old }).result, OTHER_SERIES, "the dead one's")
   equal(a.relay, false, "still off")
end)

test("what cannot be radiated takes its number and changes nothing else", function()
   local a = taken()
   equal(a.numbered(20, 3, 4000).result, ACCEPTED, "on")
   equal(a.numbered(-1, 4, 500).result, RADIO_DENIED, "below the least power")
   equal(a.numbered(0 / 0, 5, 500).result, RADIO_DENIED, "not a number")
   equal(a.numbered(20, 6, 5020).result, RADIO_DENIED, "too far ahead")
   equal(a.reports[#a.reports].newest, 6, "newest")
   equal(a.relay, true, "still on")
   a.mode = 5
   equal(a.numbered(20, 7, 500).result, RADIO_NOT_NOW, "LOITER")
   equal(a.relay, false, "the pilot's mode")
   equal(a.reports[#a.reports].power_mdbm, OFF, "says so")
end)

test("it states itself five times a second, and its clock wraps", function()
   local a = taken()
   local before = #a.reports
   a.pass(1000)
   assert(#a.reports - before >= 4 and #a.reports - before <= 6, #a.reports - before)
   equal(a.reports[#a.reports].answers, 0, "unasked")
   local last = a.reports[#a.reports].time_ms
   assert((a.now_ms & 0xFFFFFFFF) - last < 220, "its clock")
   for number = 3, 300 do -- 30 s over the wrap at 20 s
      equal(a.numbered(20, number, 150).result, ACCEPTED, "renewal")
      equal(a.relay, true, "on")
      a.pass(89)
   end
   assert(a.reports[#a.reports].time_ms < 20000, "wrapped")
   a.pass(150)
   equal(a.relay, false, "off")
end)

-- The worst that can wait for a run: as many messages as it looks at, and those that cost most last.
local function worst_bursts(a)
   local number = 2
   local function numbered(form)
      number = number + 1
      local message = { command = 31010, target_system = 2, target_component = 1, param1 = 10, param2 = number, param3 = 5 }
      message.x, message.z, message.autocontinue = 7, 1, 1 -- no zeros at the end: as long as can be
      local y = (a.now_ms + 400) & 0xFFFFFFFF
      message.y = y > 0x7FFFFFFF and y - 0x100000000 or y
      return wire.pack("COMMAND_INT", 2, 191, message, form)
   end
   local function others()
      return wire.pack("COMMAND_LONG", 255, 190, { command = 512, target_system = 2, target_component = 1, param1 = 242 })
   end
   local function offset()
      return wire.pack("COMMAND_LONG", 2, 191, {
         command = 31013,
         target_system = 2,
         target_component = 1,
         param1 = 30 * (number % 2),
         param2 = -20,
         confirmation = 1,
      })
   end
   return {
      ["numbered commands"] = function()
         return numbered()
      end,
      ["damaged ones"] = function()
         return numbered({ damaged = true })
      end,
      ["everybody's commands"] = others,
      ["everybody's commands, ours among them"] = function(at)
         return at < 24 and others() or numbered()
      end,
      ["offsets"] = offset,
   }
end

test("no burst of messages costs the bridge half of what a run may take", function()
   for what in pairs(worst_bursts({})) do
      local a = taken()
      equal(a.switch(1), ACCEPTED, "switch")
      hold(a, 30, -20, 200)
      local message = worst_bursts(a)[what]
      a.counts = true
      for _ = 1, 300 do
         for at = 1, 25 do
            a.receive(message(at))
         end
         a.pass(2)
      end
      a.counts = false
      local most = a.most["ardupilot/veilwing.lua"]
      print(string.format("   %s: %d of %d instructions", what, most, autopilot.ALLOWANCE))
      assert(a.bridge_lives(), what)
      assert(most > 200 and most < autopilot.ALLOWANCE / 2, what .. ": " .. most)
      assert(a.most["ardupilot/veilwing_guard.lua"] < 500, a.most["ardupilot/veilwing_guard.lua"])
   end
end)

test("what waits for the next run is obeyed then, in order, and what found no room is lost", function()
   local a = taken()
   for number = 3, 40 do
      local message = { command = 31010, target_system = 2, target_component = 1, param1 = 10, param2 = number, param3 = 5 }
      local y = (a.now_ms + 400) & 0xFFFFFFFF
      message.y = y > 0x7FFFFFFF and y - 0x100000000 or y
      a.receive(wire.pack("COMMAND_INT", 2, 191, message))
   end
   local before = #a.reports
   a.pass(10)
   local answers = {}
   for at = before + 1, #a.reports do
      answers[#answers + 1] = a.reports[at].answers
   end
   assert(#answers <= 3 and answers[1] == 3 and answers[2] == 4, #answers)
   a.pass(130)
   equal(a.reports[#a.reports].newest, 27, "the oldest 25")
   equal(a.relay, true, "on")
   a.pass(300)
   equal(a.relay, false, "and off: a lost command is a lease that is not renewed")
end)

test("among a ground station's fifty commands a second, in tens, offsets and leases hold", function()
   local a = taken()
   a.counts = true
   equal(a.switch(1), ACCEPTED, "switch")
   for number = 3, 102 do -- 10 s
      if number % 2 == 0 then
         for _ = 1, 10 do
            a.receive(wire.pack("COMMAND_LONG", 255, 190, { command = 512, target_system = 2, target_component = 1 }))
         end
      end
      equal(a.numbered(20, number, 200).result, ACCEPTED, "renewal")
      equal(a.offset(12, 0), ACCEPTED, "offset")
      a.pass(39)
      equal(a.offset(12, 0), ACCEPTED, "offset")
      a.pass(28)
      equal(a.relay, true, "on")
   end
   equal(a.offsets[1], 12, "roll")
   assert(a.bridge_lives())
end)

test("a damaged command, which the firmware hands on, is none", function()
   local a = autopilot.boot()
   equal(a.command("COMMAND_LONG", 31011, {}, { damaged = true }), nil, "kill")
   equal((a.lease(20, 500)), ACCEPTED, "not killed")
end)

test("a ground station that speaks MAVLink 1 is understood", function()
   local a = autopilot.boot()
   equal((a.command("COMMAND_LONG", 31011, {}, { version = 1 })), ACCEPTED, "kill")
   equal((a.lease(20, 500)), DENIED, "killed")
   equal(a.command("COMMAND_LONG", 31011, {}, { version = 1, damaged = true }), nil, "damaged")
end)

test("without the bridge the guard levels the vehicle at the tilt rate, and the radio is off when it was to be", function()
   local a = taken()
   equal(a.switch(1), ACCEPTED, "switch")
   hold(a, 40, -30, 1500)
   local sent_at = a.now_ms
   equal(a.numbered(20, 3, 2000).result, ACCEPTED, "on")
   a.kill_bridge()
   a.pass(250)
   equal(a.offsets[1], 40, "a pulse may be late")
   a.pass(150)
   assert(a.offsets[1] < 40, "within 0.4 s")
   assert(a.texts[#a.texts]:find("bridge is dead, going level"), a.texts[#a.texts])
   a.pass(500)
   near(math.sqrt(a.offsets[1] ^ 2 + a.offsets[2] ^ 2), 50 - 0.6 * 45, 4, "at the tilt rate")
   near(a.offsets[2] / a.offsets[1], -0.75, 1e-6, "both angles together")
   a.pass(sent_at + 2000 - 30 - a.now_ms)
   equal(a.offsets[1], 0, "level")
   equal(a.relay, true, "the other vehicle relies on it until then")
   a.pass(sent_at + 2000 - a.now_ms)
   equal(a.relay, false, "relay")
   a.pass(1)
   equal(a.pwm, 1000, "PWM")
end)

test("without the bridge the radio is off at once when the pilot takes over", function()
   local a = taken()
   equal(a.numbered(20, 3, 4000).result, ACCEPTED, "on")
   a.kill_bridge()
   a.pass(400)
   equal(a.relay, true, "still on")
   a.mode = 5
   a.pass(11)
   equal(a.relay, false, "relay")
   equal(a.pwm, 1000, "PWM")
end)

test("a bridge that runs out of instructions is gone as the firmware has it, and the guard is not", function()
   local a = taken(function(a)
      a.allowance = 600
   end)
   a.switch(1)
   hold(a, 12, 0, 500)
   a.counts = true
   a.numbered(20, 3, 500)
   equal(a.bridge_lives(), false, "bridge")
   a.pass(1000)
   equal(a.offsets[1], 0, "level")
   equal(a.relay, false, "relay")
end)

test("without the guard nothing is begun that would outlive the bridge, and it is said on the ground", function()
   local a = autopilot.boot(function(a)
      a.without_guard = true
      a.armed = false
   end)
   local FAILED = 4
   equal(a.offset(0, 0), FAILED, "a probe on the ground")
   a.armed = true
   equal(a.switch(1), FAILED, "switch")
   equal(a.offset(0, 0), ACCEPTED, "level")
   equal((a.lease(20, 500)), FAILED, "the relay")
   equal(a.relay, false, "relay")
end)

test("without a radio the commands are not supported", function()
   local a = autopilot.boot(function(a)
      a.parameters.VW_TX_FN, a.parameters.VW_TX_RELAY = 0, -1
   end)
   equal((a.lease(20, 500)), UNSUPPORTED, "lease")
   equal((a.command("COMMAND_LONG", 31011)), UNSUPPORTED, "kill")
end)

test("what is for others, or in the wrong form, changes nothing", function()
   local a = autopilot.boot()
   equal(a.command("COMMAND_INT", 31010, { param1 = 20, y = 500, target_component = 68 }), nil, "another component")
   equal(a.command("COMMAND_INT", 31010, { param1 = 20, y = 500, target_system = 9 }), nil, "another system")
   equal(a.command("COMMAND_LONG", 400, {}), nil, "another command")
   equal(a.command("COMMAND_LONG", 31010, { param1 = 20 }), UNSUPPORTED, "a lease without an expiry")
   equal(a.command("COMMAND_INT", 31013, { param1 = 20 }), UNSUPPORTED, "an offset as COMMAND_INT")
   equal(a.relay, false, "relay")
   equal(a.offsets[1], 0, "roll")
end)

test("a fault in the script is silent and level, said, and survived", function()
   local a = autopilot.boot()
   a.switch(1)
   hold(a, 30, 0, 500)
   a.lease(20, 2000)
   a.broken = true
   a.pass(30)
   equal(a.relay, false, "relay")
   assert(a.texts[#a.texts]:find("broken"), a.texts[#a.texts])
   a.broken = false
   a.pass(1500)
   equal(a.offsets[1], 0, "level")
   equal((a.lease(20, 500)), ACCEPTED, "goes on")
end)

print(passed .. " passed")
