#include "autocal_vio/calibration_io/text_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <vector>

namespace autocal_vio {
namespace {

std::string systemReason(const std::string& what, const std::string& path) {
  return "cannot " + what + " " + path + ": " + std::strerror(errno);
}

bool writeAll(int descriptor, const std::string& content) {
  std::size_t done = 0;
  while (done < content.size()) {
    const ssize_t count = ::write(descriptor, content.data() + done, content.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    done += static_cast<std::size_t>(count);
  }
  return true;
}

// The file that a symbolic link stands for: a rename would replace the link.
std::string followed(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_symlink(path, error)) return path;
  const std::filesystem::path target = std::filesystem::weakly_canonical(path, error);
  return error ? path : target.string();
}

std::string folderOf(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? "." : path.substr(0, slash + 1);
}

// mkstemp makes the file private; give it the old file's rights, or those a new file usually has.
void setUsualRights(int descriptor, const std::string& path) {
  struct stat old_file;
  const mode_t mode = ::stat(path.c_str(), &old_file) == 0 ? (old_file.st_mode & 07777) : mode_t{0644};
  if (::fchmod(descriptor, mode) != 0) errno = 0;  // rights are a nicety; the content is what counts
}

void flushFolder(const std::string& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace

// Reading a pipe would wait for somebody who writes.
std::optional<std::string> readTextFile(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return std::nullopt;
  std::ifstream stream(path, std::ios::binary);
  if (!stream) return std::nullopt;
  std::stringstream content;
  content << stream.rdbuf();
  if (stream.bad()) return std::nullopt;
  return content.str();
}

std::optional<std::string> writeFileAtomically(const std::string& link, const std::string& content) {
  const std::string path = followed(link);
  std::error_code ignored;
  // A rename would put a file in the place of a device.
  if (std::filesystem::exists(path, ignored) && !std::filesystem::is_regular_file(path, ignored) &&
      !std::filesystem::is_directory(path, ignored))
    return "cannot write " + path + ": it is no regular file";
  const std::string pattern = path + ".XXXXXX";
  std::vector<char> temporary(pattern.begin(), pattern.end());
  temporary.push_back('\0');
  const int descriptor = ::mkstemp(temporary.data());
  if (descriptor < 0) return systemReason("write", path);
  setUsualRights(descriptor, path);
  std::optional<std::string> problem;
  if (!writeAll(descriptor, content) || ::fsync(descriptor) != 0) problem = systemReason("write", path);
  if (::close(descriptor) != 0 && !problem) problem = systemReason("write", path);
  if (!problem && ::rename(temporary.data(), path.c_str()) != 0) problem = systemReason("replace", path);
  if (problem) {
    ::unlink(temporary.data());
    return problem;
  }
  flushFolder(folderOf(path));
  return std::nullopt;
}

}  // namespace autocal_vio
