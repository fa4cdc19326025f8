// Calls of a servo. The rows that describe them are in bind_servo.cpp.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

namespace vitreo::lua::servo_calls {

int position(Call& call);
int set_trim(Call& call);
int set_offset(Call& call);
int force_for(Call& call);
int status(Call& call);
int margins(Call& call);
int rotation(Call& call);
int spin(Call& call);
int clearance(Call& call);
int quality(Call& call);
int let_fall(Call& call);
int wait_until_tracked(Call& call);
int go_to(Call& call);
int follow(Call& call);
int refusal(Call& call);
int hold(Call& call);
int release(Call& call);
int snapshot(Call& call);
int mean_correction(Call& call);
int close(Call& call);

}  // namespace vitreo::lua::servo_calls
