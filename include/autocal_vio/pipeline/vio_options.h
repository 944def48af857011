// All algorithm settings (config/estimator.yaml), one section per class.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/common/option_visitor.h"
#include "autocal_vio/estimator/estimator_options.h"
#include "autocal_vio/estimator/extrinsic_monitor.h"
#include "autocal_vio/frontend/feature_tracker_options.h"
#include "autocal_vio/initializer/initializer_options.h"
#include "autocal_vio/initializer/rotation_calibrator_options.h"

namespace autocal_vio {

struct VioOptions {
  FeatureTrackerOptions tracker;
  RotationCalibratorOptions rotation_calibrator;
  InitializerOptions initializer;
  EstimatorOptions estimator;
  ExtrinsicMonitorOptions monitor;
  bool fix_extrinsics = false;  ///< never changes the extrinsics given as a prior (not a file key)

  /// Visits each section: visit("tracker", tracker), ...
  template <class Visitor>
  void visitSections(Visitor&& visit) {
    visit("tracker", tracker);
    visit("rotation_calibrator", rotation_calibrator);
    visit("initializer", initializer);
    visit("estimator", estimator);
    visit("monitor", monitor);
  }
};

/// Every violation of the bounds, as "section.key is ...".
std::vector<std::string> validateAll(VioOptions options);

}  // namespace autocal_vio
