// Conversions between the text of messages and quantities, as a file declares them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/scripted/declaration.h"

#include <optional>
#include <string>
#include <string_view>

namespace vitreo::scripted {

/// The first number in a text, where one begins: "+1.25E-03" of "T +1.25E-03,0". Nothing when there
/// is none, or one that is not finite.
std::optional<double> first_number(std::string_view text);
/// All numbers in it.
std::vector<double> numbers_in(std::string_view text);

/// The value of an answer, in SI; nothing where it is none of that type, or not one of the choices.
std::optional<QuantityValue> value_of(const PropertyDeclaration& property, std::string_view text);

/// The message that sets the value: `format` has at most one directive of string.format. `value` is
/// in SI. Throws ScriptFault for a format that does not fit.
std::string message_for(Sandbox& sandbox, const std::string& format,
                        const std::vector<QuantityValue>& values);

/// The capture of a Lua pattern in a text, or the whole match; nothing where it does not match.
std::optional<std::vector<std::string>> captures(Sandbox& sandbox, const std::string& text,
                                                 const std::string& pattern);

/// A value as the file sees it: in the declared unit, a choice by the instrument's own name.
QuantityValue to_declared(const QuantityValue& value, const DeclaredUnit& unit,
                          const std::map<std::string, std::string>& choices);

/// Throws std::invalid_argument for another type, DeviceError{out_of_range} under `device` beyond
/// the bounds.
void check_value(const QuantityInfo& info, const QuantityValue& value, const std::string& device);

}  // namespace vitreo::scripted
