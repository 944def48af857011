// The IMU's noise level found from the residuals of solved graphs, against the simulation's.
#include "autocal_vio/graph/noise_adaptation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>

#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

struct NoiseCase {
  NoiseFactors truth;
  std::uint64_t seed = 1;
  double pixel_sigma = 0.5;
  int keyframes = 50;
};

struct Batch {
  VisualInertialGraph graph;
  NoiseAdaptation noise;
};

// A batch of keyframes every 0.2 s, started at the truth, whose IMU is noisier than the rig says.
Batch makeBatch(const NoiseCase& noise, double largest) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(noise.seed);
  simulation.motion.duration = 5.0 + 0.2 * noise.keyframes;
  simulation.random_rig.accelerometer_noise_factor = noise.truth.accelerometer;
  simulation.random_rig.gyroscope_noise_factor = noise.truth.gyroscope;
  simulation.pixel_sigma = noise.pixel_sigma;
  simulation.max_tracks = 80;
  const FeatureDataset data = simulateFeatures(simulation);
  ImuBuffer imu(100 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  CalibrationPrior prior;
  prior.sigma_translation.setConstant(0.3);
  Batch batch{VisualInertialGraph(GraphOptions(), prior), NoiseAdaptation(data.rig.rig.imu_noise, largest)};
  batch.graph.calibration().setTransform(data.rig.T_imu_cam);
  constexpr std::size_t kFirst = 80, kStep = 4;
  for (int k = 0; k < noise.keyframes; ++k) {
    const std::size_t i = kFirst + static_cast<std::size_t>(k) * kStep;
    FrameState frame;
    frame.id = batch.graph.nextFrameId();
    frame.stamp = data.truth[i].stamp;
    frame.features = data.frames[i].features;
    frame.setPose(data.truth[i].T_WB);
    frame.setMotion(data.truth[i].velocity_W, data.truth[i].bias);
    frame.measured_angular_velocity = imu.at(frame.stamp)->angular_velocity;
    if (k > 0)
      frame.preintegration = std::make_shared<Preintegration>(
          imu.slice(data.truth[i - kStep].stamp, frame.stamp), data.truth[i].bias, data.rig.rig.imu_noise);
    batch.graph.addFrame(std::move(frame));
    batch.graph.landmarkMap().closeFullLandmarks();
  }
  batch.graph.anchorFirstFrame(0.1, 0.3);
  return batch;
}

class NoiseAdaptationFinds : public ::testing::TestWithParam<NoiseFactors> {};

// docs/derivation.md (D54)-(D59), all together.
TEST_P(NoiseAdaptationFinds, TheTrueFactors) {
  double log_accelerometer = 0.0, log_gyroscope = 0.0;
  constexpr int kSeeds = 4;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    NoiseCase noise;
    noise.truth = GetParam();
    noise.seed = seed;
    Batch batch = makeBatch(noise, 40.0);
    ASSERT_EQ(solveAdaptingNoise(20, 4.0, &batch.graph, &batch.noise), "");
    const double accelerometer = batch.noise.factors().accelerometer / noise.truth.accelerometer;
    const double gyroscope = batch.noise.factors().gyroscope / noise.truth.gyroscope;
    // 49 intervals beside tracks of 0.5 px, which hardly see the noise of a good gyroscope.
    EXPECT_NEAR(std::log(accelerometer), 0.0, 0.8) << seed;
    EXPECT_NEAR(std::log(gyroscope), 0.0, 0.8) << seed;
    log_accelerometer += std::log(accelerometer) / kSeeds;
    log_gyroscope += std::log(gyroscope) / kSeeds;
    // What the adaptation says is what the graph was integrated with.
    EXPECT_EQ(batch.graph.frames().back().preintegration->noise().accelerometer_noise_density,
              batch.noise.noise().accelerometer_noise_density);
  }
  std::printf("%g %g: mean log ratio %.2f %.2f\n", GetParam().accelerometer, GetParam().gyroscope,
              log_accelerometer, log_gyroscope);
  EXPECT_NEAR(log_accelerometer, 0.0, 0.3);
  EXPECT_NEAR(log_gyroscope, 0.0, 0.35);
}

INSTANTIATE_TEST_SUITE_P(Factors, NoiseAdaptationFinds,
                         ::testing::Values(NoiseFactors{1.0, 1.0}, NoiseFactors{12.0, 2.3},
                                           NoiseFactors{5.0, 1.0}, NoiseFactors{2.0, 6.0}));

// docs/derivation.md (D58).
TEST(NoiseAdaptation, StaysWithinItsBounds) {
  NoiseCase noise;
  noise.truth = {12.0, 2.0};
  Batch batch = makeBatch(noise, 4.0);
  ASSERT_EQ(solveAdaptingNoise(20, 4.0, &batch.graph, &batch.noise), "");
  EXPECT_EQ(batch.noise.factors().accelerometer, 4.0);
  EXPECT_GE(batch.noise.factors().gyroscope, 1.0);
  EXPECT_LE(batch.noise.factors().gyroscope, 4.0);
}

TEST(NoiseAdaptation, AnImuBetterThanItsDataSheetKeepsTheDataSheet) {
  NoiseCase noise;
  noise.truth = {0.2, 0.2};
  Batch batch = makeBatch(noise, 40.0);
  ASSERT_EQ(solveAdaptingNoise(20, 4.0, &batch.graph, &batch.noise), "");
  EXPECT_LT(batch.noise.factors().accelerometer, 1.1);
  EXPECT_LT(batch.noise.factors().gyroscope, 1.1);
  EXPECT_GE(batch.noise.factors().accelerometer, 1.0);
  EXPECT_GE(batch.noise.factors().gyroscope, 1.0);
}

// Intervals stay in the window for seconds. What they were integrated with is what their residuals are measured by, not the
// factors that are found in the meantime: docs/derivation.md, after (D59).
TEST(NoiseAdaptation, IntervalsOfOlderFactorsSayTheSame) {
  NoiseCase noise;
  noise.truth = {12.0, 2.3};
  noise.seed = 3;
  Batch batch = makeBatch(noise, 40.0);
  ASSERT_EQ(solveAdaptingNoise(20, 4.0, &batch.graph, &batch.noise), "");
  const std::optional<GraphCovariance> covariance = batch.graph.covariance();
  ASSERT_TRUE(covariance);
  const NoiseFactors found = batch.noise.factors();
  for (const NoiseFactors& start : {NoiseFactors{4.0, 1.0}, NoiseFactors{30.0, 10.0}}) {
    // No repropagation: the intervals keep the noise that was found above.
    NoiseAdaptation other(scaled(batch.noise.noise(), {1.0 / found.accelerometer, 1.0 / found.gyroscope}),
                          40.0, start);
    for (std::size_t i = 1; i < batch.graph.frames().size(); ++i)
      other.addInterval(batch.graph, *covariance, i);
    for (int round = 0; round < 8; ++round) other.update();
    EXPECT_NEAR(other.factors().accelerometer, found.accelerometer, 0.15 * found.accelerometer);
    EXPECT_NEAR(std::log(other.factors().gyroscope / found.gyroscope), 0.0, 0.6);  // of which little is seen
  }
}

// A sensor that shows nothing is taken for one that vibrates, not for one that is as good as its data sheet.
// docs/derivation.md (D57): the prior alone.
TEST(NoiseAdaptation, WithoutEvidenceTheFactorsAreThoseOfAVibratingDrone) {
  NoiseAdaptation noise(ImuNoise(), 40.0);
  for (int i = 0; i < 50; ++i) noise.update();
  EXPECT_NEAR(noise.factors().accelerometer, 12.0, 0.1);
  EXPECT_NEAR(noise.factors().gyroscope, 2.3, 0.1);
}

// One update may change the variance by a factor of nine: a single bad solution does no lasting harm.
// docs/derivation.md (D58).
TEST(NoiseAdaptation, OneUpdateChangesTheFactorByThreeAtMost) {
  NoiseCase noise;
  noise.truth = {30.0, 30.0};
  Batch batch = makeBatch(noise, 40.0);
  ASSERT_TRUE(batch.graph.solve(20).usable);
  const std::optional<GraphCovariance> covariance = batch.graph.covariance();
  ASSERT_TRUE(covariance);
  for (std::size_t i = 1; i < batch.graph.frames().size(); ++i)
    batch.noise.addInterval(batch.graph, *covariance, i);
  batch.noise.update();
  EXPECT_GT(batch.noise.factors().accelerometer, 2.0);
  EXPECT_LE(batch.noise.factors().accelerometer, 3.0);
  EXPECT_LE(batch.noise.factors().gyroscope, 3.0);
}

// Evidence is gathered at the factors that were believed then. Taken as linear in what they have changed since, it let a
// factor of 40 come down to 3 only after half a minute. Solved again with what it leads to, it leads all the way down.
// docs/derivation.md (D59).
TEST(NoiseAdaptation, EvidenceGatheredAtFactorsTooLargeLeadsBackDown) {
  Batch batch = makeBatch(NoiseCase(), 40.0);
  const ImuNoise nominal = batch.graph.frames().back().preintegration->noise();
  batch.noise = NoiseAdaptation(nominal, 40.0, {40.0, 20.0});
  for (int round = 0; round < 3; ++round) {
    for (FrameState& frame : batch.graph.frames())
      if (frame.preintegration) frame.preintegration->repropagate(frame.bias(), batch.noise.noise());
    ASSERT_TRUE(batch.graph.solve(20).usable);
    const std::optional<GraphCovariance> covariance = batch.graph.covariance();
    ASSERT_TRUE(covariance);
    batch.noise.forgetEvidence();
    for (std::size_t i = 1; i < batch.graph.frames().size(); ++i)
      batch.noise.addInterval(batch.graph, *covariance, i);
    for (int i = 0; i < 20; ++i) batch.noise.update();
    const NoiseFactors found = batch.noise.factors();
    std::printf("from 40 20, round %d: %.2f %.2f\n", round, found.accelerometer, found.gyroscope);
    EXPECT_LT(found.accelerometer, 5.0);
    EXPECT_LT(found.gyroscope, 3.0);
  }
  EXPECT_LT(batch.noise.factors().accelerometer, 2.0);
  EXPECT_LT(batch.noise.factors().gyroscope, 2.0);
}

// Noise that grows suddenly: what many intervals say changes little at first.
// docs/derivation.md (D60).
TEST(NoiseAdaptation, TheLastFewIntervalsShowNoiseThatHasGrown) {
  double shown[2];
  for (const bool grown : {false, true}) {
    NoiseCase noise;
    noise.truth = {1.0, grown ? 20.0 : 1.0};
    Batch batch = makeBatch(noise, 40.0);
    ASSERT_TRUE(batch.graph.solve(20).usable);
    const std::optional<GraphCovariance> covariance = batch.graph.covariance();
    ASSERT_TRUE(covariance);
    for (std::size_t i = 21; i <= 25; ++i) {
      EXPECT_FALSE(batch.noise.recentFactors());
      batch.noise.addInterval(batch.graph, *covariance, i);
    }
    const std::optional<NoiseFactors> recent = batch.noise.recentFactors();
    ASSERT_TRUE(recent);
    shown[grown] = recent->gyroscope;
    batch.noise.forgetRecent();
    EXPECT_FALSE(batch.noise.recentFactors());
  }
  std::printf("gyroscope, of 1: %.2f, of 20: %.2f\n", shown[0], shown[1]);
  EXPECT_LT(shown[0], 2.0);
  EXPECT_GT(shown[1], 4.0);
}

TEST(NoiseAdaptation, ScalesTheDensitiesAndNotTheWalks) {
  ImuNoise nominal;
  nominal.accelerometer_noise_density = 2e-3;
  nominal.gyroscope_noise_density = 1.7e-4;
  nominal.accelerometer_random_walk = 3e-3;
  nominal.gyroscope_random_walk = 2e-5;
  const ImuNoise noise = scaled(nominal, {12.0, 2.5});
  EXPECT_DOUBLE_EQ(noise.accelerometer_noise_density, 2.4e-2);
  EXPECT_DOUBLE_EQ(noise.gyroscope_noise_density, 4.25e-4);
  EXPECT_EQ(noise.accelerometer_random_walk, nominal.accelerometer_random_walk);
  EXPECT_EQ(noise.gyroscope_random_walk, nominal.gyroscope_random_walk);
}

// docs/derivation.md (D61).
TEST(FittedPixelSigma, FollowsTheTracksWithinBounds) {
  for (const double sigma : {0.05, 0.5, 1.2}) {
    NoiseCase noise;
    noise.pixel_sigma = sigma;
    Batch batch = makeBatch(noise, 40.0);
    ASSERT_TRUE(batch.graph.solve(20).usable);
    const std::optional<double> fitted = fittedPixelSigma(batch.graph);
    ASSERT_TRUE(fitted);
    // Tracks are correlated in time: they are never trusted more than to 0.3 px.
    if (sigma < 0.3) {
      EXPECT_EQ(*fitted, 0.3);
    } else {
      EXPECT_NEAR(*fitted / sigma, 1.0, 0.15);
    }
  }
}

TEST(FittedPixelSigma, TooFewObservationsSayNothing) {
  NoiseCase noise;
  noise.keyframes = 2;
  Batch batch = makeBatch(noise, 40.0);
  EXPECT_FALSE(fittedPixelSigma(batch.graph));
}

}  // namespace
}  // namespace autocal_vio
