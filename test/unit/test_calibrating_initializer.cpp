// The initialiser alone, fed as the pipeline feeds it.
#include "autocal_vio/common/angle.h"
#include "autocal_vio/initializer/calibrating_initializer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

FeatureDataset simulate(const FeatureSimulationOptions& base, double seconds,
                        MotionKind kind = MotionKind::kFree) {
  FeatureSimulationOptions options = base;
  options.motion.duration = seconds;
  options.motion.kind = kind;
  return simulateFeatures(options);
}

CalibratingInitializer makeInitializer(const FeatureDataset& data,
                                       const std::optional<ExtrinsicsPrior>& prior = std::nullopt,
                                       const InitializerOptions& options = {}) {
  const CameraModel camera(*data.rig.rig.camera);
  return CalibratingInitializer(camera.focalLength(), data.rig.rig.imu_noise, prior, TimeOffsetPrior(),
                                options, RotationCalibratorOptions(), GraphOptions());
}

struct Result {
  std::optional<InitializedProblem> problem;
  double seconds = 0.0;  // at the problem, or at the end
};

// Until there is a problem. `watch` is called after each image with its time [s].
Result run(const FeatureDataset& data, CalibratingInitializer* initializer,
           const std::function<void(double)>& watch = nullptr) {
  ImuBuffer imu(60 * kNsPerSecond);
  std::size_t next = 0;
  Result result;
  for (const FeatureFrame& frame : data.frames) {
    while (next < data.imu.size() && data.imu[next].stamp <= frame.stamp + 5000000) imu.add(data.imu[next++]);
    result.seconds = toSeconds(frame.stamp - data.frames.front().stamp);
    result.problem = initializer->addFrame(frame, imu);
    if (watch) watch(result.seconds);
    if (result.problem) break;
  }
  return result;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(CalibratingInitializer, ExactDataGiveTheCalibrationAndAnUprightWorld) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const FeatureDataset data = simulate(FeatureSimulationOptions::exact(seed), 15.0);
    CalibratingInitializer initializer = makeInitializer(data);
    const Result result = run(data, &initializer);
    ASSERT_TRUE(result.problem) << seed << ": " << initializer.status().reason;
    const Transform T_BC = result.problem->graph.calibration().T_BC();
    EXPECT_LT(data.rig.T_imu_cam.rotation.angularDistance(T_BC.rotation), 0.05 * kDegree) << seed;
    EXPECT_LT((data.rig.T_imu_cam.translation - T_BC.translation).norm(), 0.003) << seed;
    EXPECT_TRUE(initializer.status().rotation_known);
    EXPECT_TRUE(initializer.status().reason.empty()) << initializer.status().reason;
    // Gravity: the vertical of each keyframe as the truth has it. Scale: the length of the path.
    double estimated = 0.0, travelled = 0.0;
    const std::deque<FrameState>& frames = result.problem->graph.frames();
    std::size_t index = 0, before = 0;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      before = index;
      while (data.truth[index].stamp < frames[k].stamp) ++index;
      ASSERT_EQ(data.truth[index].stamp, frames[k].stamp);
      const Transform& truth = data.truth[index].T_WB;
      const Eigen::Vector3d up = frames[k].rotation().conjugate() * Eigen::Vector3d::UnitZ();
      EXPECT_LT((up - truth.rotation.conjugate() * Eigen::Vector3d::UnitZ()).norm(), 0.01)
          << seed << ", " << k;
      if (k == 0) continue;
      estimated += (frames[k].position() - frames[k - 1].position()).norm();
      travelled += (truth.translation - data.truth[before].T_WB.translation).norm();
    }
    EXPECT_NEAR(estimated / travelled, 1.0, 0.005) << seed;
    // What the status shows is the same solution.
    const Transform T_WC0 = frames.front().T_WB() * T_BC;
    const Eigen::Vector3d gravity_W(0.0, 0.0, -9.81);
    EXPECT_LT((initializer.status().gravity_C0 - T_WC0.rotation.conjugate() * gravity_W).norm(), 1e-9);
    EXPECT_LT(initializer.status().sigma_gravity, 0.02);
    EXPECT_GT(initializer.status().sigma_gravity, 1e-5);
  }
}

TEST(CalibratingInitializer, AtRestNothingIsTriedAndTheStatusAsksForMotion) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(1), 8.0, MotionKind::kStandstill);
  CalibratingInitializer initializer = makeInitializer(data);
  EXPECT_FALSE(run(data, &initializer).problem);
  EXPECT_FALSE(initializer.status().rotation_known);
  EXPECT_EQ(initializer.status().attempts, 0);
  EXPECT_TRUE(contains(initializer.status().reason, "standstill")) << initializer.status().reason;
  EXPECT_FALSE(initializer.status().motion_advice.empty());
  EXPECT_FALSE(initializer.rotation());
}

TEST(CalibratingInitializer, RotationAloneGivesTheRotationAndNoScale) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(2), 10.0, MotionKind::kPureRotation);
  CalibratingInitializer initializer = makeInitializer(data);
  EXPECT_FALSE(run(data, &initializer).problem);
  ASSERT_TRUE(initializer.status().rotation_known);
  EXPECT_LT(data.rig.T_imu_cam.rotation.angularDistance(*initializer.rotation()), 0.5 * kDegree);
  EXPECT_GT(initializer.status().attempts, 0);
  EXPECT_FALSE(initializer.status().motion_advice.empty());
}

// An attempt takes as long as many images take to come; what comes meanwhile is handed over with the solution.
TEST(CalibratingInitializer, ImagesGoOnWhileAnAttemptRuns) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(2), 60.0);
  InitializerOptions options;
  options.in_background = true;
  CalibratingInitializer initializer = makeInitializer(data, std::nullopt, options);
  const Result result =
      run(data, &initializer, [](double) { std::this_thread::sleep_for(std::chrono::milliseconds(2)); });
  ASSERT_TRUE(result.problem);
  const std::vector<FeatureFrame>& later = result.problem->later;
  EXPECT_GT(later.size(), 5u);
  EXPECT_EQ(toSeconds(later.back().stamp - data.frames.front().stamp), result.seconds);
  for (std::size_t i = 1; i < later.size(); ++i) EXPECT_GT(later[i].stamp, later[i - 1].stamp);
}

TEST(CalibratingInitializer, AKeyframeAfterALongGapOfTheImuStartsAnewAndSaysWhy) {
  FeatureDataset data = simulate(FeatureSimulationOptions::euroc(1), 4.0);
  const TimeNs gap = data.frames[30].stamp;
  data.imu.erase(
      std::remove_if(data.imu.begin(), data.imu.end(),
                     [&](const ImuSample& s) { return s.stamp > gap && s.stamp < gap + 700000000; }),
      data.imu.end());
  CalibratingInitializer initializer = makeInitializer(data, ExtrinsicsPrior{data.rig.T_imu_cam, 0.01, 0.01});
  bool named = false;
  run(data, &initializer, [&](double) {
    named = named || contains(initializer.status().reason, "begun anew, since the IMU was silent for 0.7");
  });
  EXPECT_TRUE(named) << initializer.status().reason;
}

TEST(CalibratingInitializer, KeyframesThatShareNoTracksStartAnew) {
  FeatureDataset data = simulate(FeatureSimulationOptions::euroc(3), 6.0);
  std::size_t cut = data.frames.size();
  for (std::size_t i = 0; i < data.frames.size(); ++i) {
    if (toSeconds(data.frames[i].stamp - data.frames.front().stamp) < 1.5) continue;
    cut = std::min(cut, i);
    for (Feature& feature : data.frames[i].features) feature.track_id += 1000000;
  }
  ExtrinsicsPrior prior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01};
  CalibratingInitializer initializer = makeInitializer(data, prior);
  const double cut_seconds = toSeconds(data.frames[cut].stamp - data.frames.front().stamp);
  bool seen = false;
  const Result result = run(data, &initializer, [&](double t) {
    if (t < cut_seconds || t > cut_seconds + 0.85) return;  // a bad image is waited out for half a second
    seen = seen || contains(initializer.status().reason, "collecting keyframes for scale and gravity: 1 of");
  });
  EXPECT_TRUE(seen) << initializer.status().reason;
  ASSERT_TRUE(result.problem) << initializer.status().reason;
  EXPECT_GE(result.problem->graph.frames().front().stamp, data.frames[cut].stamp);
}

// As that of a camera on a bad cable, whose tracks the next image has again.
TEST(CalibratingInitializer, AnImageWithoutTheTracksDoesNotBreakTheChain) {
  FeatureDataset data = simulate(FeatureSimulationOptions::euroc(3), 6.0);
  for (std::size_t i = 8; i < data.frames.size(); i += 20)
    for (Feature& feature : data.frames[i].features)
      feature.track_id += 1000000 * static_cast<std::int64_t>(i);
  CalibratingInitializer initializer =
      makeInitializer(data, ExtrinsicsPrior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01});
  const Result result = run(data, &initializer, [&](double) {
    EXPECT_FALSE(contains(initializer.status().reason, "begun anew")) << initializer.status().reason;
  });
  EXPECT_TRUE(result.problem) << initializer.status().reason;
}

TEST(CalibratingInitializer, HeldPartsKeepEveryBitThroughTheBatch) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(4), 12.0);
  ExtrinsicsPrior prior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01};
  CalibratingInitializer initializer = makeInitializer(data, prior);
  initializer.hold(true, true, true);
  const Result result = run(data, &initializer);
  ASSERT_TRUE(result.problem) << initializer.status().reason;
  const CalibrationState& calibration = result.problem->graph.calibration();
  EXPECT_TRUE(
      (calibration.T_BC().rotation.coeffs().array() == prior.T_imu_cam.rotation.coeffs().array()).all());
  EXPECT_TRUE((calibration.T_BC().translation.array() == prior.T_imu_cam.translation.array()).all());
  EXPECT_EQ(calibration.td, 0.0);
}

TEST(CalibratingInitializer, APriorFarOffIsDroppedAndSaidSo) {
  // Rotation alone: nothing but the rotation step can tell.
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(5), 10.0, MotionKind::kPureRotation);
  const Eigen::Quaterniond wrong =
      data.rig.T_imu_cam.rotation * Eigen::AngleAxisd(30.0 * kDegree, Eigen::Vector3d::UnitX());
  ExtrinsicsPrior prior{Transform(wrong, data.rig.T_imu_cam.translation), 1.0 * kDegree, 0.01};
  CalibratingInitializer initializer = makeInitializer(data, prior);
  EXPECT_FALSE(run(data, &initializer).problem);
  EXPECT_TRUE(contains(initializer.priorProblem(), "WRONG")) << initializer.priorProblem();
  ASSERT_TRUE(initializer.rotation());
  EXPECT_LT(data.rig.T_imu_cam.rotation.angularDistance(*initializer.rotation()), 0.5 * kDegree);
}

TEST(CalibratingInitializer, AGivenPriorStartsEarlierThanNone) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(6), 15.0);
  CalibratingInitializer from_nothing = makeInitializer(data);
  CalibratingInitializer from_prior =
      makeInitializer(data, ExtrinsicsPrior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01});
  const Result nothing = run(data, &from_nothing), prior = run(data, &from_prior);
  ASSERT_TRUE(nothing.problem && prior.problem);
  EXPECT_LE(prior.seconds, nothing.seconds);
}

// Where the noise keeps the scale from ever being known as well as wished, the odometry begins all the same.
TEST(CalibratingInitializer, AScaleThatStaysUnsureIsWaitedForNoLongerThanThePatience) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(6), 11.0);
  InitializerOptions options;
  CalibratingInitializer usual = makeInitializer(data, std::nullopt, options);
  const Result at_once = run(data, &usual);
  ASSERT_TRUE(at_once.problem) << usual.status().reason;
  options.relaxed_max_sigma_scale = options.max_sigma_scale;
  options.max_sigma_scale = 0.001;
  CalibratingInitializer patient = makeInitializer(data, std::nullopt, options);
  const Result late = run(data, &patient);
  ASSERT_TRUE(late.problem) << patient.status().reason;
  EXPECT_GE(late.seconds, options.scale_patience);
  EXPECT_LE(late.seconds, at_once.seconds + options.scale_patience + 2.0 * options.attempt_interval + 0.2);
  options.scale_patience = 1e6;
  CalibratingInitializer stubborn = makeInitializer(data, std::nullopt, options);
  EXPECT_FALSE(run(data, &stubborn).problem);
  EXPECT_TRUE(contains(stubborn.status().reason, "needs 0.1 %")) << stubborn.status().reason;
  EXPECT_LE(stubborn.status().attempts, 6) << "each costs as much as dozens of images: one in 2 s is enough";
}

// Of five seconds, with the rotation known.
AttemptInput attemptInput(const FeatureDataset& data) {
  AttemptInput input{{},
                     ImuBuffer(60 * kNsPerSecond),
                     data.rig.rig.imu_noise,
                     NoiseFactors(),
                     data.rig.T_imu_cam.rotation,
                     data.truth.front().bias.gyroscope,
                     data.rig.td,
                     std::nullopt,
                     TimeOffsetPrior(),
                     false,
                     false,
                     false,
                     0.03,
                     GraphOptions()};
  for (const ImuSample& sample : data.imu) input.imu.add(sample);
  for (std::size_t i = 20; i < 120; i += 4) input.keyframes.push_back(data.frames[i]);
  return input;
}

// A reset waits for one that runs.
TEST(InitializationAttempt, EndsEarlyOnceNobodyWantsItAnyMore) {
  const FeatureDataset data = simulate(FeatureSimulationOptions::euroc(6), 8.0);
  InitializationAttempt whole(attemptInput(data), AttemptFindings());
  ASSERT_TRUE(whole.run()) << whole.findings().reason;
  InitializationAttempt cancelled(attemptInput(data), AttemptFindings());
  cancelled.cancel();
  EXPECT_FALSE(cancelled.run());
  std::printf("%.1f ms, cancelled at the beginning %.1f ms\n", whole.cpuMs(), cancelled.cpuMs());
  EXPECT_LT(cancelled.cpuMs(), 0.6 * whole.cpuMs());
  InitializationAttempt meanwhile(attemptInput(data), AttemptFindings());
  std::thread canceller([&] {
    std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(0.3 * whole.cpuMs()));
    meanwhile.cancel();
  });
  const bool solved = meanwhile.run().has_value();
  canceller.join();
  EXPECT_FALSE(solved) << "cancelled after a third of it";
}

}  // namespace
}  // namespace autocal_vio
