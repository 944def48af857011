#include "autocal_vio/calibration_io/estimator_file.h"

#include <gtest/gtest.h>

#include "autocal_vio/calibration_io/load_problems.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

TEST(EstimatorFile, ShippedFileIsTheDefaultsExactly) {
  const std::string shipped = readWholeFile(AUTOCAL_VIO_CONFIG_FOLDER "/estimator.yaml");
  EXPECT_EQ(shipped, estimatorFileText(VioOptions()))
      << "regenerate it: calibrate_bag --print-estimator-settings > config/estimator.yaml";
}

TEST(EstimatorFile, ReadsBackWhatItWrites) {
  const TemporaryFolder folder;
  VioOptions options;
  options.tracker.max_features = 123;
  options.tracker.min_contrast = 1.0 / 3.0;
  options.estimator.gravity_magnitude = 9.80665;
  const VioOptions read = loadEstimatorFile(folder.write("e.yaml", estimatorFileText(options)));
  EXPECT_EQ(estimatorFileText(read), estimatorFileText(options));
  EXPECT_EQ(read.tracker.min_contrast, 1.0 / 3.0);
}

TEST(EstimatorFile, EveryKeyIsOptional) {
  const TemporaryFolder folder;
  const VioOptions options =
      loadEstimatorFile(folder.write("e.yaml", "estimator:\n  gravity_magnitude: 9.8\ntracker:\n"));
  EXPECT_EQ(options.estimator.gravity_magnitude, 9.8);
  EXPECT_EQ(options.tracker.max_features, FeatureTrackerOptions().max_features);
}

TEST(EstimatorFile, ListsEverythingWrongAtOnce) {
  const TemporaryFolder folder;
  const std::string path = folder.write("e.yaml",
                                        "estimator:\n  gravity_magnitude: 98.1\n  gravitas: 1\n"
                                        "tracker:\n  max_features: 10.5\n  min_distance: wide\nextra: 1\n");
  try {
    loadEstimatorFile(path);
    FAIL() << "accepted";
  } catch (const LoadProblems& error) {
    const std::string text = error.what();
    EXPECT_EQ(error.problems().size(), 5u) << text;
    for (const char* part :
         {"e.yaml:2: estimator.gravity_magnitude: is 98.1, must be within [9.5, 10]",
          "estimator.gravitas: is not a known key", "tracker.max_features: expected a whole number",
          "tracker.min_distance: expected a finite number", "extra: is not a known key"}) {
      EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
    }
  }
}

}  // namespace
}  // namespace autocal_vio
