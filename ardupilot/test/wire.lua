-- MAVLink commands as ArduPilot hands them to scripts: its mavlink_message_t. Stated by tables of fields and a checksum
-- taken bit by bit, as the MAVLink documents have both, so that a wrong offset or checksum in the bridge shows.
local wire = {}

local DEFINITIONS = {
   COMMAND_INT = {
      id = 75,
      crc_extra = 158,
      fields = "param1:f param2:f param3:f param4:f x:i4 y:i4 z:f command:I2 target_system:B target_component:B frame:B current:B autocontinue:B",
   },
   COMMAND_LONG = {
      id = 76,
      crc_extra = 152,
      fields = "param1:f param2:f param3:f param4:f param5:f param6:f param7:f command:I2 target_system:B target_component:B confirmation:B",
   },
   HEARTBEAT = {
      id = 0,
      crc_extra = 50,
      fields = "custom_mode:I4 type:B autopilot:B base_mode:B system_status:B mavlink_version:B",
   },
}
-- Of a mavlink_message_t's payload, checksum bytes and padding included.
local ROOM = 264

function wire.crc(bytes)
   local sum = 0xFFFF
   for _, byte in ipairs({ bytes:byte(1, -1) }) do
      sum = sum ~ byte
      for _ = 1, 8 do
         sum = (sum & 1 == 1) and (sum >> 1) ~ 0x8408 or sum >> 1
      end
   end
   return sum
end

-- `form`: version 1 or 2 (2 unless told otherwise), damaged: with another checksum than its own.
function wire.pack(name, sysid, compid, message, form)
   form = form or {}
   local definition, payload = DEFINITIONS[name], ""
   for field, kind in definition.fields:gmatch("(%w[%w_]*):(%w+)") do
      payload = payload .. string.pack("<" .. kind, message[field] or 0)
   end
   if form.version ~= 1 then
      -- Zeros at the end are not sent.
      payload = payload:gsub("\0+$", "")
      payload = #payload > 0 and payload or "\0"
   end
   local header = string.pack("<BBBBBBI3", #payload, 0, 0, 7, sysid, compid, definition.id)
   if form.version == 1 then
      header = string.pack("<BBBBB", #payload, 7, sysid, compid, definition.id)
   end
   local sum = wire.crc(header .. payload .. string.char(definition.crc_extra))
   local magic = form.version == 1 and 0xFE or 0xFD
   return string.pack("<I2B", form.damaged and sum ~ 0x0100 or sum, magic)
      .. string.pack("<BBBBBBI3", #payload, 0, 0, 7, sysid, compid, definition.id)
      .. payload
      .. string.rep("\0", ROOM - #payload)
end

return wire
