#include "autocal_vio/common/angle.h"
#include "autocal_vio/sim/rig_simulator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <opencv2/core.hpp>
#include <vector>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

std::vector<RigEvent> allEvents(RigSimulator* simulator) {
  std::vector<RigEvent> events;
  while (const std::optional<RigEvent> event = simulator->next()) events.push_back(*event);
  return events;
}

SimulatedRigOptions shortRun() {
  SimulatedRigOptions options;
  options.duration = 5.0;
  options.td = 0.012;
  return options;
}

TEST(RigSimulator, EventsComeInOrderOfTimeAtTheirRates) {
  RigSimulator simulator(shortRun());
  const std::vector<RigEvent> events = allEvents(&simulator);
  std::int64_t images = 0, samples = 0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const RigEvent& event = events[i];
    if (i > 0) {
      EXPECT_GE(event.time, events[i - 1].time);
    }
    EXPECT_GE(event.time, simulator.begin());
    EXPECT_LE(event.time, simulator.end());
    if (event.type == RigEventType::kImage) {
      EXPECT_EQ(event.index, images++);
      EXPECT_EQ(event.time - event.stamp, 12000000);
      EXPECT_EQ(event.truth.stamp, event.stamp);
      EXPECT_EQ(event.truth.stamp_imu, event.time);
    } else {
      EXPECT_EQ(event.index, samples++);
      EXPECT_EQ(event.imu.stamp, event.time);
    }
  }
  EXPECT_EQ(images, 100);
  EXPECT_EQ(samples, 1001);
  EXPECT_FALSE(simulator.next());
}

TEST(RigSimulator, AnImageBeforeTheBeginningIsLeftOut) {
  SimulatedRigOptions options = shortRun();
  options.td = -0.07;
  RigSimulator simulator(options);
  const std::vector<RigEvent> events = allEvents(&simulator);
  for (const RigEvent& event : events) EXPECT_GE(event.time, simulator.begin());
  EXPECT_EQ(events.front().type, RigEventType::kImu);
}

TEST(RigSimulator, TheSameOptionsGiveTheSameBytesWhicheverImagesAreRendered) {
  RigSimulator a(shortRun()), b(shortRun());
  const std::vector<RigEvent> events_a = allEvents(&a), events_b = allEvents(&b);
  ASSERT_EQ(events_a.size(), events_b.size());
  std::vector<RigEvent> images;
  for (std::size_t i = 0; i < events_a.size(); ++i) {
    EXPECT_EQ(events_a[i].imu.acceleration, events_b[i].imu.acceleration);
    if (events_b[i].type == RigEventType::kImage) images.push_back(events_b[i]);
  }
  a.renderImage(images[10]);
  const cv::Mat image_a = a.renderImage(images[30]), image_b = b.renderImage(images[30]);
  EXPECT_EQ(image_a.type(), CV_8UC1);
  EXPECT_EQ(image_a.size(), cv::Size(752, 480));
  EXPECT_EQ(cv::norm(image_a, image_b, cv::NORM_INF), 0.0);
}

TEST(RigSimulator, ImageNoiseIsWhiteWithItsSigma) {
  SimulatedRigOptions options = shortRun();
  RigSimulator noisy(options);
  options.gray_noise = 0.0;
  RigSimulator clean(options);
  RigEvent event;
  do event = *noisy.next();
  while (event.type != RigEventType::kImage || event.index < 20);
  cv::Mat difference;
  cv::subtract(noisy.renderImage(event), clean.renderImage(event), difference, cv::noArray(), CV_32F);
  cv::Scalar mean, sigma;
  cv::meanStdDev(difference, mean, sigma);
  EXPECT_NEAR(mean[0], 0.0, 0.05);
  EXPECT_NEAR(sigma[0], 2.0, 0.1);
  const double neighbours = cv::mean(difference.colRange(1, 752).mul(difference.colRange(0, 751)))[0];
  EXPECT_LT(std::abs(neighbours) / 4.0, 0.02);
}

TEST(RigSimulator, MotionBlurSmoothsAMovingImageOnly) {
  SimulatedRigOptions options = shortRun();
  options.gray_noise = 0.0;
  RigSimulator sharp(options);
  options.motion_blur = 0.02;
  RigSimulator blurred(options);
  RigEvent still, moving;
  while (const std::optional<RigEvent> event = sharp.next()) {
    if (event->type != RigEventType::kImage) continue;
    if (event->index == 5) still = *event;
    if (event->index == 90) moving = *event;
  }
  const auto contrast = [](const cv::Mat& image) {
    cv::Mat step;
    cv::absdiff(image.colRange(1, 752), image.colRange(0, 751), step);
    return cv::mean(step)[0];
  };
  EXPECT_LE(cv::norm(sharp.renderImage(still), blurred.renderImage(still), cv::NORM_INF), 1.0);
  EXPECT_LT(contrast(blurred.renderImage(moving)), 0.95 * contrast(sharp.renderImage(moving)));
}

TEST(RigSimulator, ABumpMovesTheMountFromTheNextImageOn) {
  SimulatedRigOptions options = shortRun();
  options.bump_time = 2.5;
  RigSimulator simulator(options);
  const Transform before = simulator.rig().T_imu_cam;
  Transform last = before;
  int changes = 0;
  for (const RigEvent& event : allEvents(&simulator)) {
    if (event.type != RigEventType::kImage) continue;
    const Transform delta = last.inverse() * event.truth.T_imu_cam;
    last = event.truth.T_imu_cam;
    if (delta.translation.norm() < 1e-12) continue;
    ++changes;
    EXPECT_NEAR(logSo3(delta.rotation).norm(), 5.0 * kDegree, 1e-9);
    EXPECT_NEAR(delta.translation.norm(), 0.03, 1e-9);
    EXPECT_NEAR(toSeconds(event.time - simulator.begin()), 2.5, 0.06);
  }
  EXPECT_EQ(changes, 1);
  simulator.bump(Transform(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.01, 0.0, 0.0)));
  EXPECT_NEAR((simulator.rig().T_imu_cam.translation - last.translation).norm(), 0.01, 1e-12);
}

TEST(RigSimulator, FollowsARecordedTrajectoryWithItsImu) {
  const std::string poses = ::testing::TempDir() + "poses.csv", imu = ::testing::TempDir() + "imu.csv";
  const SineTrajectory original((SineTrajectoryOptions()));
  std::ofstream a(poses), b(imu);
  a << std::setprecision(12);
  for (TimeNs i = 0; i < 2000; ++i) {
    const TimeNs t = original.begin() + i * 5000000;
    const Transform T = original.at(t).T_WB;
    a << t << ',' << T.translation.x() << ',' << T.translation.y() << ',' << T.translation.z() << ','
      << T.rotation.w() << ',' << T.rotation.x() << ',' << T.rotation.y() << ',' << T.rotation.z() << '\n';
    b << t << ",0.1,0.2,0.3,1,2," << i << '\n';
  }
  a.close();
  b.close();
  SimulatedRigOptions options;
  options.trajectory_path = poses;
  options.imu_path = imu;
  options.recorded_start = 1.0;
  options.duration = 4.0;
  RigSimulator simulator(options);
  EXPECT_EQ(simulator.begin(), original.begin() + kNsPerSecond);
  const std::vector<RigEvent> events = allEvents(&simulator);
  EXPECT_EQ(events.front().imu.acceleration.z(), 200.0);
  const RigEvent& last = events.back();
  EXPECT_LT((last.truth.T_WB.translation - original.at(last.time).T_WB.translation).norm(), 1e-3);
  EXPECT_NEAR(toSeconds(last.time - simulator.begin()), 4.0, 0.01);
  std::remove(poses.c_str());
  std::remove(imu.c_str());
}

TEST(RigSimulator, TakesTheSensorsOfARigFileButNotItsPriors) {
  RigModel sensors;
  sensors.camera = eurocIntrinsics();
  sensors.camera->width = 640;
  sensors.imu_noise.gyroscope_noise_density = 1e-3;
  sensors.extrinsics_prior = ExtrinsicsPrior();
  const RigSimulator simulator(shortRun(), sensors);
  EXPECT_EQ(simulator.rig().rig.camera->width, 640);
  EXPECT_EQ(simulator.rig().rig.imu_noise.gyroscope_noise_density, 1e-3);
  EXPECT_FALSE(simulator.rig().rig.extrinsics_prior);
}

TEST(RigSimulator, RefusesEverythingWrongAtOnce) {
  SimulatedRigOptions options;
  options.image_rate = -1.0;
  options.motion = "backflip";
  try {
    const RigSimulator simulator(options);
    FAIL() << "no exception";
  } catch (const std::invalid_argument& problem) {
    EXPECT_NE(std::string(problem.what()).find("image_rate"), std::string::npos);
    EXPECT_NE(std::string(problem.what()).find("backflip"), std::string::npos);
  }
}

}  // namespace
}  // namespace autocal_vio
