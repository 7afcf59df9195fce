-- For the test alone: ArduPilot ships its own.
local fields = {}
for k = 1, 7 do
   fields[k] = { "param" .. k, "<f" }
end
fields[8], fields[9] = { "command", "<I2" }, { "target_system", "<B" }
fields[10], fields[11] = { "target_component", "<B" }, { "confirmation", "<B" }
return { id = 76, fields = fields }
