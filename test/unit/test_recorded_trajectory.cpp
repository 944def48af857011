#include "autocal_vio/sim/recorded_trajectory.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <iomanip>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

using Eigen::Vector3d;

std::vector<TimedPose> sampled(const Trajectory& trajectory, TimeNs step) {
  std::vector<TimedPose> poses;
  for (TimeNs t = trajectory.begin(); t <= trajectory.end(); t += step)
    poses.push_back({t, trajectory.at(t).T_WB});
  return poses;
}

SineTrajectory sine() {
  SineTrajectoryOptions options;
  options.seed = 3;
  options.duration = 15.0;
  return SineTrajectory(options);
}

TEST(RecordedTrajectory, FollowsTheRecordedMotion) {
  const SineTrajectory original = sine();
  const RecordedTrajectory recorded(sampled(original, 5000000));
  EXPECT_EQ(recorded.begin(), original.begin());
  for (double t = 0.3; t < 14.7; t += 0.173) {
    const RigMotion a = original.at(original.begin() + fromSeconds(t));
    const RigMotion b = recorded.at(original.begin() + fromSeconds(t));
    EXPECT_LT((a.T_WB.translation - b.T_WB.translation).norm(), 1e-4);
    EXPECT_LT(a.T_WB.rotation.angularDistance(b.T_WB.rotation), 1e-4);
    EXPECT_LT((a.velocity_W - b.velocity_W).norm(), 2e-3);
    EXPECT_LT((a.acceleration_W - b.acceleration_W).norm(), 0.1);
    EXPECT_LT((a.angular_velocity_B - b.angular_velocity_B).norm(), 2e-3);
  }
}

// A drone's motors shake it faster than any smooth spline follows.
TEST(RecordedTrajectory, GoesThroughShakenPosesWhereTheKnotsAreFineEnough) {
  std::vector<TimedPose> poses = sampled(sine(), 5000000);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double shake = 0.01 * std::sin(2.0 * i);  // [rad], 64 Hz
    poses[i].T_WB.rotation = poses[i].T_WB.rotation * expSo3(shake * Vector3d(1.0, 2.0, 3.0).normalized());
    poses[i].T_WB.translation.z() += 0.1 * shake;
  }
  const RecordedTrajectory smooth(poses), exact(poses, 0.002);
  double largest = 0.0, largest_smooth = 0.0;
  for (std::size_t i = 100; i + 100 < poses.size(); ++i) {
    const Transform a = poses[i].T_WB, b = exact.at(poses[i].stamp).T_WB;
    largest = std::max(largest, a.rotation.angularDistance(b.rotation));
    EXPECT_LT((a.translation - b.translation).norm(), 2e-5);
    largest_smooth =
        std::max(largest_smooth, a.rotation.angularDistance(smooth.at(poses[i].stamp).T_WB.rotation));
  }
  EXPECT_LT(largest, 2e-4);
  EXPECT_GT(largest_smooth, 8e-3);
}

TEST(RecordedTrajectory, DerivativesAreThoseOfTheSpline) {
  const RecordedTrajectory trajectory(sampled(sine(), 25000000));
  constexpr TimeNs kStep = 1000000;
  for (double s = 0.37; s < 14.0; s += 0.291) {
    const TimeNs t = trajectory.begin() + fromSeconds(s);
    const RigMotion before = trajectory.at(t - kStep), now = trajectory.at(t),
                    after = trajectory.at(t + kStep);
    const Vector3d velocity = (after.T_WB.translation - before.T_WB.translation) / 2e-3;
    const Vector3d acceleration = (after.velocity_W - before.velocity_W) / 2e-3;
    const Vector3d rate =
        logSo3((before.T_WB.rotation.conjugate() * after.T_WB.rotation).normalized()) / 2e-3;
    EXPECT_LT((velocity - now.velocity_W).norm(), 5e-5);
    EXPECT_LT((acceleration - now.acceleration_W).norm(), 5e-4);
    EXPECT_LT((rate - now.angular_velocity_B).norm(), 5e-5);
  }
}

TEST(RecordedTrajectory, ReadsBothFormatsAlike) {
  const std::vector<TimedPose> poses = sampled(sine(), 50000000);
  const std::string euroc = ::testing::TempDir() + "euroc.csv", tum = ::testing::TempDir() + "odometry.tum";
  std::ofstream a(euroc), b(tum);
  a << "#timestamp, p_RS_R_x [m], ...\n" << std::setprecision(12);
  b << "# stamp tx ty tz qx qy qz qw\n\n" << std::setprecision(12);
  for (const TimedPose& pose : poses) {
    const Vector3d& p = pose.T_WB.translation;
    const Eigen::Quaterniond& q = pose.T_WB.rotation;
    a << pose.stamp << ',' << p.x() << ',' << p.y() << ',' << p.z() << ',' << q.w() << ',' << q.x() << ','
      << q.y() << ',' << q.z() << ",0,0,0\r\n";
    b << pose.stamp / kNsPerSecond << '.' << std::setfill('0') << std::setw(9) << pose.stamp % kNsPerSecond
      << ' ' << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' '
      << q.w() << '\n';
  }
  a.close();
  b.close();
  const std::vector<TimedPose> from_euroc = readTrajectory(euroc), from_tum = readTrajectory(tum);
  ASSERT_EQ(from_euroc.size(), poses.size());
  ASSERT_EQ(from_tum.size(), poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(from_euroc[i].stamp, poses[i].stamp);
    EXPECT_EQ(from_tum[i].stamp, poses[i].stamp);
    EXPECT_LT((from_tum[i].T_WB.translation - poses[i].T_WB.translation).norm(), 1e-10);
    EXPECT_LT(from_euroc[i].T_WB.rotation.angularDistance(poses[i].T_WB.rotation), 1e-7);
    EXPECT_LT(from_tum[i].T_WB.rotation.angularDistance(poses[i].T_WB.rotation), 1e-7);
  }
  std::remove(euroc.c_str());
  std::remove(tum.c_str());
}

TEST(RecordedTrajectory, BadFilesAreNamed) {
  EXPECT_THROW(readTrajectory("/nonexistent/trajectory.csv"), std::invalid_argument);
  const std::string path = ::testing::TempDir() + "broken.csv";
  std::ofstream(path) << "1,2,3\n";
  try {
    readTrajectory(path);
    FAIL() << "no exception";
  } catch (const std::invalid_argument& problem) {
    EXPECT_NE(std::string(problem.what()).find("broken.csv:1"), std::string::npos) << problem.what();
  }
  std::remove(path.c_str());
  std::vector<TimedPose> poses = sampled(sine(), 50000000);
  poses[5].stamp = poses[4].stamp;
  EXPECT_THROW(RecordedTrajectory{poses}, std::invalid_argument);
  poses.resize(3);
  EXPECT_THROW(RecordedTrajectory{poses}, std::invalid_argument);
}

}  // namespace
}  // namespace autocal_vio
