-- Plan of `vitreo reproduce`: protocols with numbers of the thesis, their rigs, arguments and seeds. Started in the order of
-- the keys, the long ones first; `brief` is the short form, for a check that all of it works ("-": left out there);
-- `laboratory` is the rig of real drivers on which the same runs among emulated instruments (`--laboratory`). Entries
-- with `joins` are rows about several runs: the median of all that the named rows are medians of.
-- SPDX-License-Identifier: Apache-2.0
local um = require("units").um

return {
  a1_spiral = {
    protocol = "localize_spiral",
    rig = "spiral_coni",
    arguments = "orientation=x eyes=20 pictures=1",
    brief = "eyes=1 orientation=x turns=0.5 height=2mm",
    laboratory = "octomag_lab",
    laboratory_arguments = "orientation=x eyes=1 pictures=1 turns=0.5 height=2mm",
  },
  a2_spiral_z = { protocol = "localize_spiral", rig = "spiral_coni_z", arguments = "orientation=z eyes=20 pictures=1" },
  a3_spiral_sphere = { protocol = "localize_spiral", rig = "spiral_sphere", arguments = "eyes=20 pictures=1" },
  a9_spirals_x = {
    joins = { "5.5.goal.x.x", "5.5.goal.z.x", "5.5.goal.sphere.x" },
    id = "5.5.goal.x",
    what = "three spirals: mean error along x in each eye, median",
    where = "goal",
    unit = "m",
    at_most = 50 * um,
    reason = "this project's goal",
  },
  a9_spirals_z = {
    joins = { "5.5.goal.x.z", "5.5.goal.z.z", "5.5.goal.sphere.z" },
    id = "5.5.goal.z",
    what = "three spirals: mean error along z in each eye, median",
    where = "goal",
    unit = "m",
    at_most = 150 * um,
    reason = "this project's goal",
  },
  a4_focus = {
    protocol = "localize_by_focus",
    rig = "bare_sensor",
    laboratory = "octomag_lab_focus",
    laboratory_arguments = "angles=2 surfaces=2 repetitions=3",
  },
  b1_square = { protocol = "servo_square", brief = "width=1mm depth=1mm speed=1mm/s", laboratory = "octomag_lab" },
  b2_square_z = { protocol = "servo_square", rig = "ellipsoid", arguments = "orientation=z" },
  b3_square_perturbed = { protocol = "servo_square", arguments = "eye=perturbed eyes=20" },
  b4_square_perturbed_z = { protocol = "servo_square", rig = "ellipsoid", arguments = "orientation=z eye=perturbed eyes=20" },
  b5_drift = {
    protocol = "drift_test",
    arguments = "machines=3",
    laboratory = "octomag_lab",
    laboratory_arguments = "machines=1 hold=3s settle=1s",
  },
  c1_eye_tracking = { protocol = "track_in_eye", rig = "color_eye", brief = "images=4 legs=1 channels=RG" },
  c2_occluded = { protocol = "track_occluded", rig = "color_occluded", brief = "images=4 passes=1 speed=3mm/s" },
  c3_colors = { protocol = "select_colors", rig = "color_eye", brief = "images=4" },
  c4_discs = { protocol = "push_discs", rig = "push_discs", brief = "images=6 way=1mm" },
  d1_gels = {
    protocol = "motion_in_gels",
    brief = "gels=1 robot=ndfeb time=1s",
    laboratory = "octomag_lab",
    laboratory_arguments = "gels=1 robot=ndfeb time=1s",
  },
  d2_supervised = { protocol = "servo_supervised", brief = "points=1,0,0", laboratory = "octomag_lab" },
  e1_biometric = { protocol = "calibrate_biometric", rig = "bare_sensor", laboratory = "octomag_lab_focus" },
  e2_autofocus = {
    protocol = "autofocus_sweep",
    rig = "bare_sensor",
    brief = "steps=9 repetitions=1",
    laboratory = "octomag_lab_focus",
  },
  e3_fundus = {
    protocol = "scan_fundus",
    rig = "fundus_scanner",
    brief = "views=2 turn=20deg refocus=false",
    laboratory = "octomag_lab_fundus",
    laboratory_arguments = "views=4",
  },
  f1_lens = { protocol = "design_condensing_lens", brief = "fields=5" },
  f2_pose = { protocol = "sensitivity_pose", brief = "eyes=2" },
  f3_focus = { protocol = "sensitivity_focus", brief = "" },
  f4_maps = { protocol = "map_isofocus_isopixel", brief = "" },
  f5_methods = { protocol = "compare_ophthalmoscopes", brief = "" },
}
