// The card at the head of the reference: the calls with which most scripts get along.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::lua {

/// By their full names, in the order of a script: chosen by how many of protocols/ use them. A test
/// compares them with the rows and with the protocols.
inline constexpr const char* kEverydayCalls[] = {"rig:learn_background",
                                                 "rig:servo",
                                                 "sample:remove_robot",
                                                 "sample:insert_robot",
                                                 "camera:grab",
                                                 "servo:hold",
                                                 "servo:wait_until_tracked",
                                                 "servo:go_to",
                                                 "servo:follow",
                                                 "servo:position",
                                                 "run:checkpoint",
                                                 "run:each",
                                                 "run:progress",
                                                 "run:wait",
                                                 "run:now",
                                                 "run:confirm",
                                                 "run:note",
                                                 "run:record",
                                                 "run:samples",
                                                 "run:result",
                                                 "run:table",
                                                 "run:plot",
                                                 "run:picture",
                                                 "run:defer",
                                                 "format_quantity"};

}  // namespace vitreo::lua
