#include "autocal_vio/tools/result_folder.h"

#include <unistd.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/text_file.h"

namespace autocal_vio {
namespace {

constexpr const char* kFiles[] = {"odometry.tum", "extrinsics.csv", "report.yaml", "convergence.png",
                                  "camchain-imucam.yaml"};

}  // namespace

ResultFolder::ResultFolder(const std::string& path, bool overwrite) : path_(path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw LoadProblems({path + ": cannot be created: " + error.message()});
  if (!std::filesystem::is_directory(path, error)) throw LoadProblems({path + ": is not a folder"});
  if (::access(path.c_str(), W_OK | X_OK) != 0) throw LoadProblems({path + ": cannot be written to"});
  if (overwrite) return;
  for (const char* name : kFiles) {
    if (std::filesystem::exists(file(name), error))
      throw LoadProblems({file(name) + ": exists already; --force overwrites it"});
  }
}

void ResultFolder::writeText(const std::string& name, const std::string& content) const {
  if (const auto problem = writeFileAtomically(file(name), content)) throw LoadProblems({*problem});
}

void ResultFolder::writePng(const std::string& name, const cv::Mat& image) const {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".png", image, bytes)) throw LoadProblems({file(name) + ": the image cannot be encoded"});
  writeText(name, std::string(bytes.begin(), bytes.end()));
}

void ResultFolder::writeCamchain(const std::string& name, const KalibrCamchain& camchain) const {
  if (const auto problem = writeKalibrCamchain(file(name), camchain)) throw LoadProblems({*problem});
}

}  // namespace autocal_vio
