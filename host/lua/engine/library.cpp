// SPDX-License-Identifier: Apache-2.0
#include "host/lua/engine/library.h"

#include "host/lua/control/bind_control.h"
#include "host/lua/control/bind_fit.h"
#include "host/lua/optics/classes.h"
#include "host/lua/prompt/prompt_calls.h"
#include "host/lua/reference/help.h"
#include "host/lua/rig/classes.h"
#include "host/lua/run/classes.h"
#include "host/lua/vision/classes.h"

namespace vitreo::lua {

const Library& library() {
  static const Library kLibrary{.classes = {&rig_class(),
                                            &camera_class(),
                                            &coils_class(),
                                            &lens_mover_class(),
                                            &sample_class(),
                                            &stage_class(),
                                            &rotation_stage_class(),
                                            &motion_class(),
                                            &field_probe_class(),
                                            &operator_input_class(),
                                            &lamp_class(),
                                            &simulation_class(),
                                            &background_class(),
                                            &servo_class(),
                                            &run_class(),
                                            &reminder_class(),
                                            &alarm_class(),
                                            &optical_system_class(),
                                            &wide_angle_map_class(),
                                            &image_class(),
                                            &video_class(),
                                            &color_model_class(),
                                            &tracker_class(),
                                            &background_tracker_class(),
                                            &retina_map_class(),
                                            &autofocus_class(),
                                            &localizer_class(),
                                            &viewing_chain_class(),
                                            &axis_law_class(),
                                            &trajectory_class(),
                                            &control_law_class(),
                                            &field_model_class()},
                                .globals = &global_functions(),
                                .prompt = &prompt_functions(),
                                .modules = {{"optics", &optics_functions()},
                                            {"control", &control_functions()},
                                            {"fit", &fit_functions()},
                                            {"vision", &vision_functions()},
                                            {"files", &files_functions()}}};
  return kLibrary;
}

}  // namespace vitreo::lua
