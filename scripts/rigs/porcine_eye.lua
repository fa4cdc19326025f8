-- The laboratory with a cadaver porcine eye whose optics are intact (thesis 7.2, 7.4): a pig's lens of 8 mm and anterior chamber
-- of 1.5 mm behind the condensing lens, its vitreous in its cavity, the NdFeB cylinder of 1 mm, 15 frames a second. There is no
-- side camera: a pig's eye is not transparent from the side. What of the optics is the thesis' and what is assumed:
-- docs/porcine_session.md.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag with a porcine eye",
  model = { eye = "porcine_condensing", robot = "ndfeb_cylinder_1mm" },
  side_camera = false,
  truth = { gel = { name = "porcine_vitreous" } },
}
