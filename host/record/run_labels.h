// Labels of a run: tags, and what is known of the sample, checked as they are given.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

/// Sets `tags[key]`, a text. Throws std::invalid_argument for a key that is no word (letters,
/// digits, '_', '-' and '.', first a letter), and for a value that is empty, longer than 1000
/// bytes or more than a line.
void set_tag(nlohmann::json& tags, const std::string& key, const std::string& value);

/// "eye", "species", "age", "died", "removed", "pipette", "light", "robot".
const std::vector<std::string>& sample_fields();
/// Sets a field of the sample. "died" and "removed", when the animal died and when the eye was
/// removed, are times such as 2026-11-24T08:10 (here) or 2026-11-24T08:10+01:00, and are kept as
/// UTC; the others are texts as of a tag. Throws std::invalid_argument naming the field.
void set_sample_field(nlohmann::json& sample, const std::string& field, const std::string& value);

/// "key=value" as two. Throws std::invalid_argument without the sign.
std::pair<std::string, std::string> key_and_value(const std::string& word);

}  // namespace vitreo
