-- The laboratory of thesis 6.1, case (c): the model eye's optics are taken out, the microscope looks on the robot from above
-- and the second camera from the side. Nothing limits the sight but the images: the edge may be 6 mm aside.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag without the model eye's optics",
  top_camera = { view = "plain", microscope = false, projection = false, sensor = { brightness = 200, vignette = 0 } },
  lens_mover = false,
  stage = false,
}
