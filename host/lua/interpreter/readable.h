// File access of scripts: the files that may be read for them, and the folder for those they write.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace vitreo::lua {

struct Context;

/// The file or folder that a script names. It must lie below the current folder, below a folder of
/// scripts, in the run's own folder, or be (or lie below) what a person gave as one of the run's
/// parameters: a script by itself reaches nothing else. Symbolic links count as what they point at.
/// Throws std::invalid_argument naming the path.
std::filesystem::path readable(const Context& context, const std::string& path);

/// A new file of the run's folder, by its plain name. Throws std::invalid_argument when the name
/// has a folder or another letter than letters, digits, '-', '_', '.', or belongs to the record, or
/// exists. Of a protocol at the prompt, a file that one before it wrote does not stand in the way:
/// the new one is called name_2.csv, and readable() finds it by the protocol's own name for it.
std::filesystem::path writable(Context& context, const std::string& name);
/// What a file of the run's folder is called, by the name that the protocol gave it.
std::string name_in_run(const Context& context, const std::string& name);

}  // namespace vitreo::lua
