-- Feedback of the servo loop by color and shape (thesis 8): its parameters in a protocol, and the model of the robot behind it,
-- from a file, from images with masks, or on a simulated rig learnt at the beginning.
-- SPDX-License-Identifier: Apache-2.0
local color_scene = require "session.color_scene"
local vision = require "vision"

local color_feedback = {}

--- The parameters of a protocol that offers it, into its table of `parameters`.
function color_feedback.add_parameters(parameters)
  parameters.feedback = {
    choices = { "one_camera", "color", "color_and_background" },
    default = "one_camera",
    help = "what the top camera sees the robot by: a learnt background, colors and shape, or the better one of both",
  }
  parameters.model = { default = "", help = "of feedback by color: a file that color_model:save wrote" }
  parameters.training = { default = "", help = "instead: a folder of images NAME.png with masks NAME_mask.png" }
  return parameters
end

--- What rig:servo wants for the protocol's feedback: {feedback =, model =}. On a simulated rig with a pose sensor, and without a
--- file or a folder, `images` (12) are learnt from first, with the robot's true outline in place of a hand's.
function color_feedback.options(rig, run, p, images)
  if p.feedback == "one_camera" then return { feedback = p.feedback } end
  local model
  if p.model ~= "" then
    model = vision.color_model { file = p.model }
  elseif p.training ~= "" then
    model = vision.color_model { images = vision.training { folder = p.training } }
  elseif rig.simulation then
    model = vision.color_model { images = color_scene.training(rig, run, images or 12) }
  else
    error("feedback: " .. p.feedback .. " needs a model, or training", 0)
  end
  return { feedback = p.feedback, model = model }
end

return color_feedback
