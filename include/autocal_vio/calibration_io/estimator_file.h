// Reader and writer of the algorithm settings, config/estimator.yaml.
#pragma once

#include <string>

#include "autocal_vio/pipeline/vio_options.h"

namespace autocal_vio {

/// Reads the settings; keys that are absent keep their defaults. Throws LoadProblems listing unknown keys,
/// wrong types and values out of range.
VioOptions loadEstimatorFile(const std::string& path);

/// The whole file for `options`, every key with its meaning, unit and range. config/estimator.yaml is
/// estimatorFileText(VioOptions()).
std::string estimatorFileText(VioOptions options);

}  // namespace autocal_vio
