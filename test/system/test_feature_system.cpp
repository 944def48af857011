// The whole chain from nothing, on feature-level simulation: rotation, scale, gravity, translation, window.
#include <gtest/gtest.h>

#include <cstdlib>

#include "figure_table.h"
#include "system_run.h"

namespace autocal_vio {
namespace {

bool verbose() {
  return std::getenv("AUTOCAL_VIO_VERBOSE") != nullptr;
}

SystemOutcome runFromNothing(const FeatureSimulationOptions& simulation) {
  const FeatureDataset data = simulateFeatures(simulation);
  return runSystem(data, data.rig.rig, VioOptions(), verbose());
}

TEST(FeatureSystem, ExactDataGivesTheExactCalibration) {
  for (int seed = 1; seed <= seeds(2); ++seed) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::exact(seed);
    simulation.motion.duration = 40.0;
    const SystemOutcome outcome = runFromNothing(simulation);
    print("exact", seed, outcome);
    EXPECT_LT(outcome.rotation_deg, 0.01);
    EXPECT_LT(outcome.translation_m, 0.5e-3);
    EXPECT_TRUE(outcome.finite);
  }
}

TEST(FeatureSystem, EurocNoiseFromNothing) {
  for (int seed = 1; seed <= seeds(3); ++seed) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
    simulation.motion.duration = 40.0;
    const SystemOutcome outcome = runFromNothing(simulation);
    print("euroc", seed, outcome);
    EXPECT_EQ(outcome.final_state, VioState::kConverged) << outcome.final_reason;
    EXPECT_LT(outcome.rotation_deg, 0.3);
    EXPECT_LT(outcome.translation_m, 0.015);
    EXPECT_LT(outcome.ate_m, 0.01 * outcome.distance_m);
    EXPECT_EQ(outcome.gaps, 0);
    EXPECT_TRUE(outcome.finite);
  }
}

// The data cannot tell a shifted principal point from a turned camera: only the published sigma can be right.
TEST(FeatureSystem, ThePublishedRotationSigmaHoldsAWrongPrincipalPoint) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(4);
  simulation.motion.duration = 20.0;
  FeatureDataset data = simulateFeatures(simulation);
  const double focal_length = data.rig.rig.camera->intrinsics[0];
  for (FeatureFrame& frame : data.frames)
    for (Feature& feature : frame.features) feature.normalized += Eigen::Vector2d(1.3, -0.9) / focal_length;
  RigModel rig = data.rig.rig;
  rig.camera->sigma_principal_point = 0.0;
  const SystemOutcome sure = runSystem(data, rig, VioOptions(), verbose());
  rig.camera->sigma_principal_point = 1.0;
  const SystemOutcome honest = runSystem(data, rig, VioOptions(), verbose());
  std::printf(
      "rotation error %.3f deg, translation %.1f mm; rotation %.1f sigma with a principal point taken for "
      "certain, %.1f with one known to 1 px\n",
      honest.rotation_deg, 1e3 * honest.translation_m, sure.rotation_sigmas, honest.rotation_sigmas);
  EXPECT_GT(sure.rotation_sigmas, 3.0);
  EXPECT_LT(honest.rotation_sigmas, 2.0);
  EXPECT_EQ(honest.converged_s, sure.converged_s);  // more motion does not help: it is not waited for
}

TEST(FeatureSystem, StandstillClaimsNothing) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(1);
  simulation.motion.kind = MotionKind::kStandstill;
  simulation.motion.duration = 20.0;
  const SystemOutcome outcome = runFromNothing(simulation);
  EXPECT_FALSE(std::isfinite(outcome.first_odometry_s));
  EXPECT_FALSE(std::isfinite(outcome.converged_s));
  EXPECT_FALSE(outcome.final_reason.empty());
}

}  // namespace
}  // namespace autocal_vio
