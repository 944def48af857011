// Reading whole files, and writing them so that a reader, or a crash, never sees half of one.
#pragma once

#include <optional>
#include <string>

namespace autocal_vio {

/// The content of a file; nothing when it cannot be read (a folder, for one).
std::optional<std::string> readTextFile(const std::string& path);

/// Writes `content` to a temporary file beside `path`, flushes it to the disk and renames it over `path`.
/// Returns nothing on success, else the reason; on failure an old file at `path` is untouched.
std::optional<std::string> writeFileAtomically(const std::string& path, const std::string& content);

}  // namespace autocal_vio
