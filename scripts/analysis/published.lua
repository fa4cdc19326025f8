-- Numbers that the thesis prints, in SI, by table and figure, and nothing else. Protocols compare theirs with them.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, deg, ms, s = units.mm, units.um, units.deg, units.ms, units.s
local published = {}

-- 3.1: full fields of view; 3.1.2: the working distance that the vitrectomy lens asks for.
published.field_of_view = { direct = 10 * deg, vitrectomy = 40 * deg, indirect = 100 * deg }
published.vitrectomy_working_distance = 20 * mm

-- Table 3.4: the asphere of the condensing lens' surface that faces the eye.
published.table_3_4 = { a4 = 4.078e-5 / mm ^ 3, a6 = -1.542e-7 / mm ^ 5, a8 = -2.647e-9 / mm ^ 7, a10 = 2.023e-11 / mm ^ 9 }

-- 4.1: equation (4.1) and what stands around it; 4.4 of the model eye of chapter 4.
published.chapter_4 = {
  magnification = 0.76,
  numerical_aperture = 0.159,
  depth_of_focus = 95 * um,
  depth_of_field = 150 * um,
  model_eye = { magnification = 0.78, depth_of_focus = 83 * um, depth_of_field = 500 * um },
}
published.figure_3_5 = { sensor_step = 1.27 * mm }
published.figure_4_8 = { sensor_step = 0.7 * mm }
published.figure_5_1 = { pixel_step = 3.5 * mm }

-- 4.2, figure 4.2: the largest error that the index of the lens brings, and the order of the five that matter.
published.figure_4_2 = {
  lens_index = 4.5 * mm,
  ranking = { "lens.index", "vitreous.index", "cornea.anterior.radius", "aqueous.index", "cornea.index" },
}
published.figure_4_6 = { lens_index_before = 4 * mm, retina_repeatability = 0.3 * mm }

-- Table 4.1: errors (uncertainty) by focus; rows: field angles, columns: surfaces 1 to 5.
published.table_4_1 = {
  angles = { 0, 5 * deg, 10 * deg, 15 * deg, 20 * deg, 25 * deg, 30 * deg },
  errors = {
    { 5, 201, 195, 201, 271 },
    { 410, 310, 285, 204, 329 },
    { 125, 362, 250, 331, 300 },
    { 105, 100, 195, 364, 394 },
    { 481, 556, 381, 569, 520 },
    { 126, 572, 207, 393, 430 },
    { 556, 162, 424, 644, 405 },
  },
  uncertainties = {
    { 102, 79, 102, 119, 119 },
    { 60, 52, 48, 50, 85 },
    { 79, 48, 60, 100, 47 },
    { 156, 98, 79, 55, 145 },
    { 100, 73, 111, 90, 364 },
    { 128, 156, 55, 161, 139 },
    { 153, 188, 301, 186, 195 },
  },
  unit = um,
  mean = 325 * um,
  deviation = 158 * um,
}

-- Table 5.2 with its rows put right (docs/optics.md): mean error and standard deviation by pose.
published.table_5_2 = {
  ["lens.posterior.radius"] = { 282 * um, 105 * um },
  ["cornea.posterior.radius"] = { 272 * um, 80 * um },
  ["lens.thickness"] = { 466 * um, 240 * um },
  ["aqueous.thickness"] = { 481 * um, 96 * um },
  ["cornea.thickness"] = { 295 * um, 162 * um },
  ["lens.anterior.radius"] = { 266 * um, 89 * um },
  ["cornea.anterior.radius"] = { 361 * um, 76 * um },
  ["vitreous.index"] = { 364 * um, 6 * um },
  ["lens.index"] = { 616 * um, 160 * um },
  ["aqueous.index"] = { 422 * um, 98 * um },
  ["cornea.index"] = { 283 * um, 82 * um },
}

-- Table 5.4: mean, standard deviation, maximum along x and z of the three spirals; 5.5: their size.
published.table_5_4 = {
  { name = "CoNi along x", x = { 93 * um, 49 * um, 248 * um }, z = { 249 * um, 177 * um, 721 * um } },
  { name = "CoNi along z", x = { 46 * um, 30 * um, 145 * um }, z = { 310 * um, 192 * um, 836 * um } },
  { name = "NdFeB sphere", x = { 80 * um, 54 * um, 280 * um }, z = { 171 * um, 119 * um, 530 * um } },
}
published.spiral = { height = 6 * mm, width = 7 * mm }

-- 6.1, of Kummer 2010: the worst drift over orientations.
published.kummer_2010 = {
  ["CoNi 2 mm"] = { center_none = 150 * um / s, boundary_none = 720 * um / s, boundary_pose_sensor = 550 * um / s },
  ["Ni 0.5 mm"] = { center_none = 50 * um / s, boundary_none = 140 * um / s, boundary_pose_sensor = 60 * um / s },
}

-- Figure 6.5 and 5.5: frames a second, effective pixels. The 2.07 and 2.04 um of section 5.5 are taken ten times larger
-- (facts: the field would be 1.4 mm).
published.rig =
  { frame_period = 1 / 15, top_pixel = 20.7 * um, side_pixel = 20.4 * um, grasshopper_pixel = 14.3 * um, latency = 130 * ms }

-- 7.1: CoNi moves in the thinnest gel by tumbling only; NdFeB from the porcine to reported human values.
published.gels =
  { count = 11, human = { 6, 8, 11 }, agar = { 1.098, 1.27, 1.42, 1.56, 1.68, 1.80, 1.91, 2.014, 2.11, 2.21, 2.30 } }

-- Table 8.2: quality of pairs of channels, 1-2, 2-3, 1-3: mean and standard deviation; 8.3.3: thresholds.
published.table_8_2 = {
  { "RGB", { 1.66, 0.03 }, { 0.53, 0.06 }, { 1.61, 0.05 } },
  { "YUV", { 1.52, 0.08 }, { 1.63, 0.05 }, { 1.64, 0.04 } },
  { "YIQ", { 1.63, 0.04 }, { 1.63, 0.03 }, { 1.56, 0.03 } },
  { "HSV", { 1.41, 0.06 }, { 1.66, 0.07 }, { 1.58, 0.06 } },
  { "XYZ", { 1.59, 0.06 }, { 1.50, 0.07 }, { 1.59, 0.06 } },
  { "nRGB", { 1.49, 0.05 }, { 1.47, 0.05 }, { 1.49, 0.05 } },
}
published.thresholds = { RG = { -0.17, 1.71 }, YV = { -0.11, 1.69 }, HS = { -0.77, 0.77 }, YU = { -0.13, 1.64 } }

-- Table 8.3: tracking errors in px and rad: center, axes, angle.
published.table_8_3 = {
  RG = { 2.15, 2.06, 2.36, 1.65, 7.62 * deg },
  YV = { 2.03, 2.20, 2.38, 1.82, 8.26 * deg },
  YU = { 3.72, 9.30, 2.96, 2.70, 18.30 * deg },
}

-- 7.2: the hours that a cadaver eye stays clear.
published.porcine_window = { 3 * 3600, 4 * 3600 }

return published
