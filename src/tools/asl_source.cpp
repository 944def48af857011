#include "autocal_vio/tools/asl_source.h"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/tools/decode_image.h"

namespace autocal_vio {
namespace {

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string> splitAtCommas(const std::string& line) {
  std::vector<std::string> fields;
  std::size_t begin = 0;
  for (std::size_t comma = line.find(','); comma != std::string::npos; comma = line.find(',', begin)) {
    fields.push_back(trimmed(line.substr(begin, comma - begin)));
    begin = comma + 1;
  }
  fields.push_back(trimmed(line.substr(begin)));
  return fields;
}

std::optional<TimeNs> parseStamp(const std::string& text) {
  char* end = nullptr;
  errno = 0;
  const long long value = std::strtoll(text.c_str(), &end, 10);
  if (text.empty() || *end != '\0' || errno != 0 || value <= 0) return std::nullopt;
  return static_cast<TimeNs>(value);
}

std::optional<ImuSample> parseImuRow(const std::vector<std::string>& fields) {
  if (fields.size() != 7) return std::nullopt;
  const std::optional<TimeNs> stamp = parseStamp(fields[0]);
  if (!stamp) return std::nullopt;
  std::array<double, 6> values;
  for (std::size_t i = 0; i < 6; ++i) {
    char* end = nullptr;
    values[i] = std::strtod(fields[i + 1].c_str(), &end);
    if (fields[i + 1].empty() || *end != '\0') return std::nullopt;
  }
  ImuSample sample;
  sample.stamp = *stamp;
  sample.angular_velocity << values[0], values[1], values[2];
  sample.acceleration << values[3], values[4], values[5];
  if (!sample.isFinite()) return std::nullopt;
  return sample;
}

// Calls `use` with the fields and the place of each row that is neither empty nor a comment.
void readTable(const std::string& path,
               const std::function<void(const std::vector<std::string>&, const std::string&)>& use) {
  std::ifstream stream(path);
  if (!stream) throw LoadProblems({path + ": cannot be read"});
  int number = 0;
  for (std::string line; std::getline(stream, line);) {
    ++number;
    line = trimmed(line);
    if (!line.empty() && line[0] != '#') use(splitAtCommas(line), path + ":" + std::to_string(number));
  }
}

}  // namespace

std::optional<std::string> findAslFolder(const std::string& path) {
  std::error_code ignored;
  for (const std::filesystem::path& folder :
       {std::filesystem::path(path), std::filesystem::path(path) / "mav0"}) {
    if (std::filesystem::is_directory(folder / "cam0", ignored) ||
        std::filesystem::is_directory(folder / "imu0", ignored))
      return folder.string();
  }
  return std::nullopt;
}

AslSource::AslSource(const std::string& mav0_folder, WarningSink warn)
    : folder_(mav0_folder), warn_(std::move(warn)) {
  readImuTable(folder_ + "/imu0/data.csv");
  readImageTable(folder_ + "/cam0/data.csv", folder_ + "/cam0/data");
}

void AslSource::readImuTable(const std::string& path) {
  readTable(path, [this](const std::vector<std::string>& fields, const std::string& place) {
    if (const std::optional<ImuSample> sample = parseImuRow(fields)) {
      imu_.push_back(*sample);
    } else {
      ++bad_imu_;
      warn_(place + ": expected a stamp [ns] and six finite numbers; the row is skipped");
    }
  });
  if (imu_.empty()) throw LoadProblems({path + ": has no usable row"});
}

void AslSource::readImageTable(const std::string& path, const std::string& folder) {
  readTable(path, [this, &folder](const std::vector<std::string>& fields, const std::string& place) {
    const std::optional<TimeNs> stamp = parseStamp(fields[0]);
    if (stamp && fields.size() == 2 && !fields[1].empty()) {
      images_.push_back({*stamp, folder + "/" + fields[1]});
    } else {
      ++bad_images_;
      warn_(place + ": expected a stamp [ns] and a file name; the row is skipped");
    }
  });
  if (images_.empty()) throw LoadProblems({path + ": has no usable row"});
}

std::optional<TimeNs> AslSource::imuStamp() {
  if (next_imu_ >= imu_.size()) return std::nullopt;
  return imu_[next_imu_].stamp;
}

std::optional<TimeNs> AslSource::imageStamp() {
  if (next_image_ >= images_.size()) return std::nullopt;
  return images_[next_image_].stamp;
}

std::optional<ImageFrame> AslSource::takeImage() {
  const ImageEntry& entry = images_[next_image_++];
  const std::optional<std::string> bytes = readTextFile(entry.file);
  const cv::Mat image = bytes ? decodeGrey(bytes->data(), bytes->size()) : cv::Mat();
  if (!image.empty()) return ImageFrame{entry.stamp, image};
  ++bad_images_;
  warn_(entry.file + ": cannot be read as an image; it is skipped");
  return std::nullopt;
}

std::string AslSource::description() const {
  return "ASL folder " + folder_ + ": " + std::to_string(images_.size()) + " images, " +
         std::to_string(imu_.size()) + " IMU samples";
}

}  // namespace autocal_vio
