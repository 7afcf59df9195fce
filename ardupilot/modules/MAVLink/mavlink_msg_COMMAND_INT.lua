-- COMMAND_INT as on the wire: fields by falling size, as MAVLink orders them.
return {
   id = 75,
   crc_extra = 158,
   fields = {
      { "param1", "<f" },
      { "param2", "<f" },
      { "param3", "<f" },
      { "param4", "<f" },
      { "x", "<i4" },
      { "y", "<i4" },
      { "z", "<f" },
      { "command", "<I2" },
      { "target_system", "<B" },
      { "target_component", "<B" },
      { "frame", "<B" },
      { "current", "<B" },
      { "autocontinue", "<B" },
   },
}
