-- A stand-in for the module of this name that comes with ArduPilot: the same functions on plain "header, payload" bytes.
-- It packs and unpacks by the tables of fields, so that a wrong table shows.
local msgs = {}

local function definition(name)
   return require("MAVLink/mavlink_msg_" .. name)
end

function msgs.get_msgid(name)
   return definition(name).id
end

function msgs.pack(name, system, component, message)
   local bytes = string.pack("<I3BB", definition(name).id, system, component)
   for _, field in ipairs(definition(name).fields) do
      bytes = bytes .. string.pack(field[2], message[field[1]] or 0)
   end
   return bytes
end

function msgs.decode(bytes, names)
   local msgid, system, component, offset = string.unpack("<I3BB", bytes)
   local message = { msgid = msgid, sysid = system, compid = component }
   for _, field in ipairs(definition(names[msgid]).fields) do
      message[field[1]], offset = string.unpack(field[2], bytes, offset)
   end
   return message
end

function msgs.encode(name, message)
   local payload = ""
   for _, field in ipairs(definition(name).fields) do
      payload = payload .. string.pack(field[2], assert(message[field[1]], field[1]))
   end
   return definition(name).id, payload
end

return msgs
