#include "autocal_vio/estimator/standing_frame.h"

#include <gtest/gtest.h>

#include <cmath>

#include "autocal_vio/estimator/predicted_frame.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

constexpr double kDuration = 60.0;  // [s]
constexpr double kSigmaVelocity = 0.01;
constexpr double kBiasSigma = 5e-3;  // [rad/s] of what is known before
constexpr int kKeyframeStep = 4;     // images

FeatureDataset standingRig(std::uint64_t seed) {
  FeatureSimulationOptions options = FeatureSimulationOptions::euroc(seed);
  options.motion.kind = MotionKind::kStandstill;
  options.motion.duration = kDuration;
  return simulateFeatures(options);
}

class StandingFrameTest : public ::testing::TestWithParam<int> {
 protected:
  StandingFrameTest()
      : data_(standingRig(GetParam())), imu_(2000 * kNsPerSecond), graph_(options(), prior()) {
    for (const ImuSample& sample : data_.imu) imu_.add(sample);
    for (next_ = 1; next_ <= 3 * kKeyframeStep; next_ += kKeyframeStep) addKeyframe(next_);
    next_ = 2 * kKeyframeStep + 2;
    append();
    StandingFrame::declare(kSigmaVelocity, &graph_);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(9, 9) * kBiasSigma * kBiasSigma;
    standing_ = std::make_unique<StandingFrame>(covariance, &graph_);
  }

  static GraphOptions options() { return GraphOptions(); }
  CalibrationPrior prior() const {
    CalibrationPrior prior;
    prior.T_BC = data_.rig.T_imu_cam;
    prior.td = data_.rig.td;
    return prior;
  }
  const ImuNoise& noise() const { return data_.rig.rig.imu_noise; }
  const FrameState& standing() const { return graph_.frames()[graph_.frames().size() - 2]; }

  // Known is a gyroscope's bias that is wrong by 0.4 of its sigma.
  ImuBias firstBias() const {
    return {data_.truth[0].bias.gyroscope + Eigen::Vector3d(0.0, 0.002, -0.002), Eigen::Vector3d::Zero()};
  }

  void addKeyframe(std::size_t i) {
    FrameState frame;
    frame.id = graph_.nextFrameId();
    frame.stamp = data_.frames[i].stamp;
    frame.reference_td = data_.rig.td;
    frame.features = data_.frames[i].features;
    frame.setPose(data_.truth[i].T_WB);
    frame.setMotion(Eigen::Vector3d::Zero(), firstBias());
    if (!graph_.frames().empty())
      frame.preintegration = std::make_shared<Preintegration>(
          imu_.slice(graph_.frames().back().stamp + fromSeconds(data_.rig.td),
                     frame.stamp + fromSeconds(data_.rig.td)),
          firstBias(), noise());
    graph_.addFrame(frame);
  }

  void append() {
    std::string problem;
    ASSERT_TRUE(appendPredictedFrame(data_.frames[next_], imu_, noise(), &graph_, &problem)) << problem;
    ++next_;
  }

  // Returns true when the standing frame has moved on.
  bool step() {
    append();
    graph_.dropSecondNewest();
    return standing_->follow(imu_, noise(), &graph_);
  }

  bool hasNext() const {
    return next_ < data_.frames.size() && imu_.covers(data_.frames[next_].stamp + fromSeconds(0.1));
  }

  FeatureDataset data_;
  ImuBuffer imu_;
  VisualInertialGraph graph_;
  std::unique_ptr<StandingFrame> standing_;
  std::size_t next_ = 0;
};

TEST_P(StandingFrameTest, ItsTimeMovesOnAndItsPoseDoesNot) {
  const std::array<double, 7> pose = standing().pose;
  const FrameId id = standing().id;
  const TimeNs begin = standing().stamp;
  int moves = 0;
  std::size_t most_landmarks = 0;
  while (hasNext()) {
    moves += step();
    ASSERT_EQ(graph_.frames().size(), 4U);
    EXPECT_EQ(standing().id, id);
    EXPECT_EQ(standing().pose, pose);
    EXPECT_EQ(graph_.frames().back().pose, pose);
    EXPECT_EQ(graph_.frames().back().velocity().norm(), 0.0);
    const double ahead = toSeconds(graph_.frames().back().stamp - standing().stamp);
    EXPECT_LT(ahead, 1.01);
    EXPECT_TRUE(moves == 0 || ahead > 0.49) << ahead;
    EXPECT_NEAR(graph_.frames().back().preintegration->duration(), ahead, 1e-6);
    most_landmarks = std::max(most_landmarks, graph_.landmarkMap().landmarks().size());
  }
  EXPECT_NEAR(moves, kDuration / 0.5, 5.0);
  EXPECT_GT(toSeconds(standing().stamp - begin), kDuration - 3.0);
  // 150 tracks live at a time and some 1400 come by.
  EXPECT_LT(most_landmarks, 450U);
  std::size_t begun_here = 0;
  for (const auto& [landmark_id, landmark] : graph_.landmarkMap().landmarks())
    begun_here += landmark.observations.front().frame == id;
  EXPECT_GT(begun_here, 100U) << "new tracks must begin in the standing frame";
}

// docs/derivation.md (D36).
TEST_P(StandingFrameTest, BiasesWalkAndTheGyroscopeIsLearned) {
  const TimeNs begin = standing().stamp;
  const Matrix15d before = standing().preintegration->covariance();
  while (hasNext()) step();
  const double time = toSeconds(standing().stamp - begin);
  const Matrix15d grown = standing().preintegration->covariance() - before;
  EXPECT_NEAR(grown(kGyroBias, kGyroBias), std::pow(noise().gyroscope_random_walk, 2) * time, 1e-12);
  EXPECT_NEAR(grown(kAccelBias, kAccelBias), std::pow(noise().accelerometer_random_walk, 2) * time, 1e-7);
  EXPECT_EQ((grown.topLeftCorner<9, 9>().norm()), 0.0);

  // What the filter tends to: P^2 = P-(walk) * reading, about density * walk for short intervals.
  const StandstillMeasurement& measured = *standing().standstill;
  const double limit = std::sqrt(noise().gyroscope_noise_density * noise().gyroscope_random_walk);
  EXPECT_GT(measured.sigma_gyroscope_bias, 0.8 * limit);
  EXPECT_LT(measured.sigma_gyroscope_bias, 1.2 * limit);
  const Eigen::Vector3d truth = data_.truth[next_ - 15].bias.gyroscope;
  EXPECT_LT((measured.gyroscope_bias - truth).cwiseAbs().maxCoeff(), 4.0 * measured.sigma_gyroscope_bias);
  // What was known before counts for next to nothing.
  EXPECT_LT((standing().bias().gyroscope - measured.gyroscope_bias).norm(),
            0.1 * measured.sigma_gyroscope_bias);
}

INSTANTIATE_TEST_SUITE_P(Seeds, StandingFrameTest, ::testing::Values(1, 2, 3));

}  // namespace
}  // namespace autocal_vio
