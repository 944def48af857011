// The camera-IMU rotation over gyroscope biases up to 0.2 rad/s: the paper's singular vector, which takes the bias for
// zero, against the joint solution, on the same ten seconds of data.
//
//   AUTOCAL_VIO_SWEEP_PNG=sweep.png test_gyroscope_bias_sweep      // draws it too
//   AUTOCAL_VIO_SEEDS=20 test_gyroscope_bias_sweep                  // more than the four seeds
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/frontend/two_view.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/hand_eye.h"
#include "autocal_vio/initializer/rotation_calibrator.h"
#include "autocal_vio/sim/feature_simulator.h"
#include "autocal_vio/tools/line_chart.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kSpan = 8;  // images between the two of a pair

int seeds() {
  const char* wanted = std::getenv("AUTOCAL_VIO_SEEDS");
  return wanted ? std::atoi(wanted) : 4;
}

FeatureDataset simulate(int seed, double bias) {
  FeatureSimulationOptions options = FeatureSimulationOptions::euroc(static_cast<std::uint64_t>(seed));
  options.motion.duration = 10.0;
  options.random_rig.min_gyroscope_bias = options.random_rig.max_gyroscope_bias = bias;
  return simulateFeatures(options);
}

ImuBuffer bufferOf(const FeatureDataset& data) {
  ImuBuffer imu(60 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  return imu;
}

// Pairs of rotations as the paper takes them: the gyroscope integrated as it reads.
std::vector<RotationPair> rotationPairs(const FeatureDataset& data, const ImuBuffer& imu) {
  std::vector<RotationPair> pairs;
  const CameraModel camera(*data.rig.rig.camera);
  TwoViewOptions options;
  options.threshold = 1.5 / camera.focalLength();
  for (std::size_t j = kSpan; j < data.frames.size(); j += kSpan / 2) {
    const FeatureFrame &first = data.frames[j - kSpan], &second = data.frames[j];
    std::vector<Eigen::Vector2d> a, b;
    for (const Feature& feature : first.features) {
      const auto found = std::lower_bound(second.features.begin(), second.features.end(), feature.track_id,
                                          [](const Feature& f, std::int64_t id) { return f.track_id < id; });
      if (found == second.features.end() || found->track_id != feature.track_id) continue;
      a.push_back(feature.normalized);
      b.push_back(found->normalized);
    }
    const TwoViewResult result = estimateTwoViewRotation(a, b, options);
    if (!result.rotation || !imu.covers(second.stamp)) continue;
    RotationPair pair;
    pair.begin = first.stamp;
    pair.end = second.stamp;
    pair.R_Ci_Cj = result.rotation->R_C1_C2;
    pair.samples = gyroSamples(imu.slice(pair.begin, pair.end));
    integratePair(Eigen::Vector3d::Zero(), 0.0, data.rig.rig.imu_noise.gyroscope_noise_density, &pair);
    pairs.push_back(std::move(pair));
  }
  return pairs;
}

double errorDeg(const Eigen::Quaterniond& R_BC, const FeatureDataset& data) {
  return data.rig.T_imu_cam.rotation.angularDistance(R_BC) / kDegree;
}

// Eq. (6)-(10), the weights once from the unweighted solution.
double paperErrorDeg(const FeatureDataset& data, const ImuBuffer& imu) {
  const std::vector<RotationPair> pairs = rotationPairs(data, imu);
  const double t0 = 5.0 * kDegree;
  const auto first = handEyeRotation(pairs, Eigen::Vector3d::Zero(), std::nullopt, t0);
  if (!first) return 180.0;
  const auto weighted = handEyeRotation(pairs, Eigen::Vector3d::Zero(), first->R_BC, t0);
  return errorDeg(weighted->R_BC, data);
}

RotationEstimate jointEstimate(const FeatureDataset& data, const ImuBuffer& imu) {
  const CameraModel camera(*data.rig.rig.camera);
  RotationCalibrator calibrator(camera.focalLength(), data.rig.rig.imu_noise, TimeOffsetPrior(),
                                RotationCalibratorOptions());
  for (const FeatureFrame& frame : data.frames) calibrator.addFrame(frame, imu);
  return calibrator.estimate();
}

void draw(const char* path, const ChartSeries& paper, const ChartSeries& joint) {
  cv::Mat image(480, 800, CV_8UC3, cv::Scalar(255, 255, 255));
  LineChart chart("Error of R_BC over the gyroscope bias [0.01 rad/s]", "deg");
  chart.add(paper);
  chart.add(joint);
  chart.setTimeRange({0.0, 20.0});
  chart.draw(&image, cv::Rect(0, 0, image.cols, image.rows));
  EXPECT_TRUE(cv::imwrite(path, image)) << path;
}

TEST(GyroscopeBiasSweep, TheJointSolutionDoesNotDependOnTheBias) {
  const char* drawn = std::getenv("AUTOCAL_VIO_SWEEP_PNG");
  ChartSeries paper{"singular vector, worst", cv::Scalar(40, 40, 200), {}, {}, {}};
  ChartSeries joint{"joint solution, worst", cv::Scalar(160, 80, 20), {}, {}, {}};
  for (int step = 0; step <= 8; step += drawn ? 1 : 2) {
    const double bias = 0.025 * step;
    double paper_worst = 0.0, joint_worst = 0.0, bias_worst = 0.0;
    for (int seed = 1; seed <= seeds(); ++seed) {
      const FeatureDataset data = simulate(seed, bias);
      const ImuBuffer imu = bufferOf(data);
      paper_worst = std::max(paper_worst, paperErrorDeg(data, imu));
      const RotationEstimate estimate = jointEstimate(data, imu);
      EXPECT_TRUE(estimate.accepted) << "seed " << seed << ", " << bias << " rad/s: " << estimate.reason;
      joint_worst = std::max(joint_worst, errorDeg(estimate.R_BC, data));
      bias_worst = std::max(bias_worst, (estimate.gyroscope_bias - data.rig.gyroscope_bias).norm());
    }
    std::printf(
        "gyroscope bias %.3f rad/s | paper's singular vector %7.3f deg | joint %6.3f deg, bias %.4f rad/s\n",
        bias, paper_worst, joint_worst, bias_worst);
    EXPECT_LT(joint_worst, 0.2) << bias << " rad/s";
    paper.time.push_back(100.0 * bias);
    paper.value.push_back(paper_worst);
    joint.time.push_back(100.0 * bias);
    joint.value.push_back(joint_worst);
  }
  if (drawn) draw(drawn, paper, joint);
}

}  // namespace
}  // namespace autocal_vio
