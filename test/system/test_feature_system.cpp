// The whole chain from nothing, on feature-level simulation: rotation, scale, gravity, translation, window.
#include <gtest/gtest.h>

#include <cstdlib>

#include "system_run.h"

namespace autocal_vio {
namespace {

bool verbose() {
  return std::getenv("AUTOCAL_VIO_VERBOSE") != nullptr;
}

int seeds(int standard) {
  const char* wanted = std::getenv("AUTOCAL_VIO_SEEDS");
  return wanted ? std::atoi(wanted) : standard;
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
  for (int seed = 1; seed <= seeds(10); ++seed) {
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
