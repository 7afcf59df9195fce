-- For the test alone: ArduPilot ships its own.
return {
   id = 77,
   fields = {
      { "command", "<I2" },
      { "result", "<B" },
      { "progress", "<B" },
      { "result_param2", "<i4" },
      { "target_system", "<B" },
      { "target_component", "<B" },
   },
}
