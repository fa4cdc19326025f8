-- hello_rig: lists the instruments of the rig and takes one image. A first test, and a start for protocols of your own.
-- SPDX-License-Identifier: Apache-2.0
return {
  title = "Hello, rig",
  needs = { "top_camera" },
  parameters = {
    frames = { default = 3, min = 1, max = 100, integer = true, help = "how many images to wait for" },
  },
  run = function(rig, p, run)
    local info = rig.top_camera:info()
    run:note(("top camera: %s, %d x %d"):format(info.identity, info.width_px, info.height_px))
    if rig.coils then
      local coils = rig.coils:info()
      run:note(("coils: %d channels, %s each"):format(coils.channels, format_quantity(coils.limit, "A")))
    end
    local first, last
    for _ in run:each(p.frames, "frame") do
      last = rig.top_camera:grab()
      first = first or last
    end
    if p.frames > 1 then run:result("frame_period", (last.time - first.time) / (last.number - first.number), "s") end
  end,
}
