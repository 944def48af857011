// The folder that calibrate_bag writes into.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "autocal_vio/calibration_io/kalibr_yaml.h"

namespace autocal_vio {

/// Every file is written whole or not at all.
class ResultFolder {
 public:
  /// Creates the folder with its parents. Throws LoadProblems where it cannot be written to, or where it
  /// holds results and `overwrite` is false.
  ResultFolder(const std::string& path, bool overwrite);

  /// Each throws LoadProblems where the file cannot be written.
  void writeText(const std::string& name, const std::string& content) const;
  void writePng(const std::string& name, const cv::Mat& image) const;
  void writeCamchain(const std::string& name, const KalibrCamchain& camchain) const;

 private:
  std::string file(const std::string& name) const { return path_ + "/" + name; }

  std::string path_;
};

}  // namespace autocal_vio
